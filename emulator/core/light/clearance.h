// How far everything that moves may go before it could meet one of a sample's rays.

struct Clearance {
  const Rod* rods;
  int rod_count;
  Float gap;    // to the nearest rod that no ray meets
  Int touched;  // bits of the rods that a ray meets
};

// The part of each ray of `lanes` up to `limit`. Whatever it is unsure of counts as nearer.
inline void note(Clearance& c, Vec origin, Vec d, Float limit, Mask lanes) {
  Float zero = splat(0.0f);
  for (int i = 0; i < c.rod_count; i++) {
    const Rod& rod = c.rods[i];
    Vec w = origin - splat(rod.center);
    Float along = dot(w, d);
    // the ball around the rod: is it nearer than what is known already?
    Float t = min(max(-along, zero), limit);
    Vec apart = w + d * t;
    Float known = c.gap + (rod.half + rod.radius);
    Mask asked = lanes & ~(dot(apart, apart) > known * known * 1.001f);
    if (!any(asked)) continue;
    if (rod.half > 0) {
      // nearest points of two segments. 1e-5: lines so parallel that each point is as near as the
      // others; the radius has room for it
      Vec axis = splat(rod.axis);
      Float on_axis = dot(w, axis), cosine = dot(d, axis);
      t = (cosine * on_axis - along) / max(1.0f - cosine * cosine, splat(1e-5f));
      t = min(max(t, zero), limit);
      Float s = min(max(cosine * t + on_axis, splat(-rod.half)), splat(rod.half));
      t = min(max(cosine * s - along, zero), limit);
      apart = w + d * t - axis * s;
    }
    // 1e-4: the rounding of all this
    Float gap = sqrt(dot(apart, apart)) * 0.9998f - (t * 1e-4f + rod.radius);
    Mask clear = gap > 0.0f;
    c.touched = select(asked & ~clear, c.touched | splat(static_cast<int>(rod.bit)), c.touched);
    c.gap = select(asked & clear, min(gap, c.gap), c.gap);
  }
}
