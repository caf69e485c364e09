// How far everything that moves may go before it could meet one of a sample's rays.

struct Clearance {
  const KeptLight* kept;
  Float gap;    // to the nearest rod that no ray meets; below 0: one that moves was met
  Int touched;  // bits of the rods that a ray meets
};

constexpr float MET = -FAR;  // the gap of what is traced again in the next tick, whatever happens

// The rays of `lanes` end on these geoms.
EVS_INLINE void meet(Clearance& c, Int geom, Mask lanes) {
  Int moving =
      as_int(gather(reinterpret_cast<const float*>(c.kept->moving), select(lanes, geom, splat(0))));
  c.gap = select(lanes & ~(moving == splat(0)), splat(MET), c.gap);
}

// The part of each ray of `lanes` up to `limit`. Whatever it is unsure of counts as nearer.
inline void note(Clearance& c, Vec origin, Vec d, Float limit, Mask lanes) {
  Float zero = splat(0.0f);
  for (int i = 0; i < c.kept->rod_count; i++) {
    lanes = lanes & (c.gap >= 0.0f);
    if (!any(lanes)) return;
    const Rod& rod = c.kept->rods[i];
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
    bool moves = rod.bit & c.kept->moved;
    c.touched = select(asked & ~clear, c.touched | splat(static_cast<int>(rod.bit)), c.touched);
    c.gap = select(asked, select(clear, min(gap, c.gap), moves ? splat(MET) : c.gap), c.gap);
  }
}
