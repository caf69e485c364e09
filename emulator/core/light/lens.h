// The lens as data: directions at the corners of pixels, and the light that each pixel gets.

// The direction through a point of the image, px: between those at the four corners of its pixel,
// so a cone that holds the corners holds it too. What overhangs the image sees its edge.
EVS_INLINE Vec through_lens(const Frame& f, Float px, Float py) {
  Float x = min(max(px, splat(0.0f)), splat(static_cast<float>(f.width)));
  Float y = min(max(py, splat(0.0f)), splat(static_cast<float>(f.height)));
  Int column = truncate(min(x, splat(static_cast<float>(f.width - 1))));
  Int row = truncate(min(y, splat(static_cast<float>(f.height - 1))));
  Float u = x - to_float(column), v = y - to_float(row);
  int below = 3 * (f.width + 1);
  Int at = row * splat(below) + column * splat(3);
  auto corner = [&](int next) {
    const float* base = f.lens + next;
    return Vec{gather(base, at), gather(base + 1, at), gather(base + 2, at)};
  };
  Vec top = corner(0), bottom = corner(below);
  top = top + (corner(3) - top) * u;
  bottom = bottom + (corner(below + 3) - bottom) * u;
  return normalize(top + (bottom - top) * v);
}

// What a pixel of the image, counted row by row, gets of the light that is meant for it.
inline float shaded(const Frame& f, long pixel, float light) {
  if (!f.share) return light;
  // outside the image circle even an infinite light is dark
  return f.share[pixel] > 0.0f ? light * f.share[pixel] : 0.0f;
}
