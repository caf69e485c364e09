// Texture lookup: coordinates as MuJoCo's viewer generates them, and trilinear filtering.
#pragma once

#include "render/simd/vec.inl"
#include "scene/scene.h"

namespace evs::EVS_NAMESPACE {
namespace {

// One mip level in each lane.
struct Level {
  Float width, height;
  Int offset, stride, face;  // start of the level, row to row, face to face
};

EVS_INLINE Level level_of(const Texture& t, Int index) {
  auto [width, height, offset, stride] =
      gather_float4(reinterpret_cast<const float*>(t.level), index + index);
  return {to_float(as_int(width)), to_float(as_int(height)), as_int(offset), as_int(stride),
          as_int(stride) * (as_int(height) + splat(1))};
}

EVS_INLINE Level level_of(const Texture& t, int index) {
  const TextureLevel& l = t.level[index];
  return {splat(static_cast<float>(l.width)), splat(static_cast<float>(l.height)), splat(l.offset),
          splat(l.stride), splat(l.stride * (l.height + 1))};
}

// Four texels around a point of a level, and the bilinear weights.
struct TexelQuad {
  Int at;  // upper left
  Float x, y;
};

// u, v in image lengths, 0 ... 1. Any value, even a NaN, gives texels inside the image and its rim.
EVS_INLINE TexelQuad texel_quad(const Level& l, Float u, Float v, Int face) {
  Float x = max(min(u * l.width + 0.5f, l.width + 0.5f), splat(0.5f));
  Float y = max(min(v * l.height + 0.5f, l.height + 0.5f), splat(0.5f));
  Int column = truncate(x), row = truncate(y);
  Int at = l.offset + face * l.face + row * l.stride + column;
  return {at, x - to_float(column), y - to_float(row)};
}

EVS_INLINE Float bilinear(const float* texels, const TexelQuad& s) {
  // each texel is stored beside the one below it
  auto [a, c, b, d] = gather_float4(texels, s.at);
  Float top = a + (b - a) * s.x, bottom = c + (d - c) * s.x;
  return top + (bottom - top) * s.y;
}

// The two mip levels around a filter width.
struct Lod {
  Level l0, l1;
  Float share;
  bool blend;  // false: every lane reads one level only
};

// In: the filter width in texels of level 0. Only `lanes` count; the others may hold anything.
EVS_INLINE Lod lod_of_width(const Texture& t, Float width, unsigned lanes) {
  // log2, linear between powers of two
  Int texels = as_int(max(width, splat(1.0f)));
  Int whole = shift_right<23>(texels) - splat(127), last = splat(t.levels - 1);
  Float share = as_float((texels & splat(0x7fffff)) | splat(0x3f800000)) - 1.0f;
  whole = select(last < whole, last, whole);
  int first = lane(whole, first_lane(lanes));
  // in most packets all lanes share one level
  if (!(~to_bits(whole == splat(first)) & lanes)) {
    int next = first + 1 < t.levels ? first + 1 : first;
    return {level_of(t, first), level_of(t, next), share, (to_bits(share > 0.0f) & lanes) != 0};
  }
  Int next = whole + splat(1);
  return {level_of(t, whole), level_of(t, select(last < next, last, next)), share, true};
}

// The same for a width in image lengths.
EVS_INLINE Lod lod_of(const Texture& t, Float footprint, unsigned lanes) {
  const TextureLevel& whole_image = t.level[0];
  float widest = static_cast<float>(whole_image.width > whole_image.height ? whole_image.width
                                                                           : whole_image.height);
  return lod_of_width(t, footprint * widest, lanes);
}

// Interpolate in level 0 of a large image, all of whose channels it returns: those of `t`.
EVS_OUTLINE void read_words(const Texture& t, const TexelQuad& s, Float* out) {
  constexpr float WEIGHTS[3] = {0.2126f, 0.7152f, 0.0722f};  // BT.709
  const float* words = reinterpret_cast<const float*>(t.words);
  Int down = splat(t.level[0].stride), right = splat(1), byte = splat(255);
  const Int at[4] = {s.at, s.at + right, s.at + down, s.at + down + right};
  Float texels[4][MAX_CHANNELS];
  const int first = t.channels == 3 ? 0 : 1;  // before it, the luminance
  for (int i = 0; i < 4; i++) {
    Int word = as_int(gather(words, at[i]));
    Float rgb[3] = {gather(t.decoded, word & byte),
                    gather(t.decoded + 256, shift_right<8>(word) & byte),
                    gather(t.decoded + 512, shift_right<16>(word) & byte)};
    if (first) texels[i][0] = rgb[0] * WEIGHTS[0] + rgb[1] * WEIGHTS[1] + rgb[2] * WEIGHTS[2];
    for (int k = 0; k < 3 && t.channels >= 3; k++) texels[i][first + k] = rgb[k];
  }
  for (int c = 0; c < t.channels; c++) {
    Float top = texels[0][c] + (texels[1][c] - texels[0][c]) * s.x;
    Float bottom = texels[2][c] + (texels[3][c] - texels[2][c]) * s.x;
    out[c] = top + (bottom - top) * s.y;
  }
}

// Interpolate in two levels and between them.
EVS_INLINE void read_levels(const Texture& t, int channels, const Lod& lod, const TexelQuad& s0,
                            const TexelQuad& s1, Mask largest, const Float* whole, Float* out) {
  for (int c = 0; c < channels; c++) {
    if (c >= t.channels) {
      out[c] = splat(t.mean);
      continue;
    }
    const float* base = t.texels + 2 * static_cast<long>(c) * t.channel_stride;
    out[c] = bilinear(base, s0);
    if (whole) out[c] = select(largest, whole[c], out[c]);
    if (lod.blend) out[c] = out[c] + (bilinear(base, s1) - out[c]) * lod.share;
  }
}

// The same of a large image, whose level 0 is stored as bytes. Never inlined: its temporaries would
// cost every read of a small image.
[[gnu::noinline]] EVS_OUTLINE void read_large_image(const Texture& t, int channels, const Lod& lod,
                                                    TexelQuad s0, const TexelQuad& s1, Float* out) {
  Float whole[MAX_CHANNELS] = {};
  Mask largest = lod.l0.width >= static_cast<float>(t.level[0].width);
  TexelQuad inside = {select(largest, s0.at, splat(0)), s0.x, s0.y};
  s0.at = select(largest, splat(0), s0.at);
  if (any(largest)) read_words(t, inside, whole);
  read_levels(t, channels, lod, s0, s1, largest, whole, out);
}

// u, v in image lengths; 2D images repeat. A channel that the image lacks reads as its mean.
EVS_INLINE void read_lod(const Texture& t, int channels, const Lod& lod, Float u, Float v, Int face,
                         Float* out) {
  if (t.faces == 1) {
    u = u - floor(u);
    v = v - floor(v);
  }
  TexelQuad s0 = texel_quad(lod.l0, u, v, face), s1 = s0;
  if (lod.blend) s1 = texel_quad(lod.l1, u, v, face);
  if (t.words) {
    const Lod levels = lod;
    const TexelQuad quad0 = s0, quad1 = s1;
    return read_large_image(t, channels, levels, quad0, quad1, out);
  }
  read_levels(t, channels, lod, s0, s1, mask_from_bits(0), nullptr, out);
}

// Trilinear lookup on `lanes`. `footprint` is the sample's width in image lengths.
EVS_OUTLINE_IN_PATHS inline void sample_texture(const Texture& t, int channels, Float u, Float v,
                                                Int face, Float footprint, unsigned lanes,
                                                Float* out) {
  read_lod(t, channels, lod_of(t, footprint, lanes), u, v, face, out);
}

// Cube map: the face of direction d and the position on it, numbered as in OpenGL (+X -X +Y -Y +Z
// -Z).
EVS_INLINE void cube_coordinates(Vec d, Float& u, Float& v, Int& face, Float& major) {
  Float ax = abs(d.x), ay = abs(d.y), az = abs(d.z);
  Mask is_x = (ax >= ay) & (ax >= az), is_y = ~is_x & (ay >= az);
  major = max(select(is_x, ax, select(is_y, ay, az)), splat(1e-30f));
  Mask negative = select(is_x, d.x, select(is_y, d.y, d.z)) < 0.0f;
  Float s =
      select(is_x, select(negative, d.z, -d.z), select(is_y, d.x, select(negative, -d.x, d.x)));
  Float t = select(is_y, select(negative, -d.z, d.z), -d.y);
  face = select(is_x, splat(0), select(is_y, splat(2), splat(4))) +
         select(negative, splat(1), splat(0));
  u = (s / major + 1.0f) * 0.5f;
  v = (t / major + 1.0f) * 0.5f;
}

// A local point in units of the shape's size, as on the viewer's unit shapes.
EVS_INLINE Vec unit_shape_point(const Geom& g, Vec p) {
  const float* s = g.size;
  switch (g.shape) {
    case SPHERE:
      return p * splat(1.0f / s[0]);
    case CAPSULE: {
      Float beyond = abs(p.z) - s[1];
      Float cap = beyond * (1.0f / s[0]) + 1.0f, side = p.z * (1.0f / s[1]);
      Float z = select(beyond > 0.0f, select(p.z < 0.0f, -cap, cap), side);
      return {p.x * (1.0f / s[0]), p.y * (1.0f / s[0]), z};
    }
    case CYLINDER:
      return {p.x * (1.0f / s[0]), p.y * (1.0f / s[0]), p.z * (1.0f / s[1])};
    case ELLIPSOID:
    case BOX:
      return {p.x * (1.0f / s[0]), p.y * (1.0f / s[1]), p.z * (1.0f / s[2])};
    default:
      return p;
  }
}

// Texture coordinates of a 2D image on a shape without coordinates of its own. Out: u, v in [0, 1)
// once around the shape (before texrepeat); uv_density: image lengths per m.
inline void shape_coordinates(const Geom& g, const Surface& s, Vec p, Float& u, Float& v,
                              float& uv_density) {
  float sx = g.size[0],
        sy = g.shape == CAPSULE || g.shape == CYLINDER || g.shape == SPHERE ? g.size[0] : g.size[1];
  if (g.shape == PLANE && (sx <= 0 || sy <= 0)) {
    // an infinite side repeats every 2 m / texrepeat, centred; a finite one spans its size
    u = sx > 0 ? (p.x * (0.5f / sx) + 0.5f) * s.repeat[0] - 0.5f
               : p.x * (0.5f * s.repeat[0]) - 0.5f;
    v = sy > 0 ? (0.5f - p.y * (0.5f / sy)) * s.repeat[1] - 0.5f
               : p.y * (-0.5f * s.repeat[1]) - 0.5f;
    float du = s.repeat[0] * (sx > 0 ? 0.5f / sx : 0.5f),
          dv = s.repeat[1] * (sy > 0 ? 0.5f / sy : 0.5f);
    uv_density = du > dv ? du : dv;
    return;
  }
  float ru = s.repeat[0] * (s.uniform ? sx : 1.0f), rv = s.repeat[1] * (s.uniform ? sy : 1.0f);
  if (g.shape == MESH || g.shape == HFIELD) {
    // object-linear: the image spans the geom's size
    float kx = s.uniform ? 1.0f : (sx > 0 ? 1.0f / sx : 1.0f);
    float ky = s.uniform ? 1.0f : (sy > 0 ? 1.0f / sy : 1.0f);
    u = p.x * (0.5f * s.repeat[0] * kx) - 0.5f;
    v = p.y * (-0.5f * s.repeat[1] * ky) - 0.5f;
    uv_density = 0.5f * (s.repeat[0] * kx > s.repeat[1] * ky ? s.repeat[0] * kx : s.repeat[1] * ky);
    return;
  }
  Vec q = unit_shape_point(g, p);
  float du = 0.5f / sx, dv = 0.5f / sy;
  switch (g.shape) {
    case SPHERE:
    case ELLIPSOID: {
      u = atan2_turns(q.y, q.x);
      Float elevation = atan2_turns(q.z, sqrt(q.x * q.x + q.y * q.y));
      elevation = select(elevation > 0.5f, elevation - 1.0f, elevation);
      v = 0.5f - elevation * 2.0f;
      du = 0.159154943f / sx;
      break;
    }
    case CAPSULE: {
      // the image covers the barrel once, and each cap once more: down to the rim, up from it
      Float beyond = abs(p.z) - g.size[1];
      Float cap = atan2_turns(max(beyond, splat(0.0f)), sqrt(p.x * p.x + p.y * p.y)) * 4.0f;
      u = atan2_turns(q.y, q.x);
      v = select(beyond > 0.0f, select(p.z < 0.0f, cap, 1.0f - cap), 0.5f - q.z * 0.5f);
      float barrel = 0.5f / (g.size[1] > 0 ? g.size[1] : sx);
      dv = 0.636619772f / sx;
      dv = dv > barrel ? dv : barrel;
      break;
    }
    case CYLINDER: {
      Mask lid = g.size[1] - abs(p.z) < g.size[0] - sqrt(p.x * p.x + p.y * p.y);
      u = select(lid, q.x * 0.5f + 0.5f, atan2_turns(q.y, q.x));
      v = select(lid, q.y * 0.5f + 0.5f, 0.5f - q.z * 0.5f);
      dv = 0.5f / (g.size[1] > 0 ? g.size[1] : sx);
      break;
    }
    case BOX: {
      Float x = abs(p.x) - g.size[0], y = abs(p.y) - g.size[1], z = abs(p.z) - g.size[2];
      Mask face_x = (x >= y) & (x >= z), face_z = (z > x) & (z > y);
      u = select(face_x, q.y, q.x) * 0.5f + 0.5f;
      v = 0.5f - select(face_z, q.y, q.z) * 0.5f;
      break;
    }
    default:  // a finite plane
      u = p.x * (0.5f / sx) + 0.5f;
      v = 0.5f - p.y * (0.5f / sy);
  }
  u = u * ru;
  v = v * rv;
  uv_density = du * ru > dv * rv ? du * ru : dv * rv;
}

// Tangents of a shape: the image's right and top in the geom's frame, not unit, and only roughly
// perpendicular to n.
inline void shape_tangents(const Geom& g, Vec p, Vec n, Vec& right, Vec& up) {
  Float zero = splat(0.0f), one = splat(1.0f);
  right = {one, zero, zero};
  up = {zero, one, zero};
  switch (g.shape) {
    case SPHERE:
    case CAPSULE:
    case ELLIPSOID:
    case CYLINDER: {
      float y = g.shape == ELLIPSOID ? g.size[1] : g.size[0];
      Vec around = {-p.y * (g.size[0] / y), p.x * (y / g.size[0]), zero};
      Vec north = cross(n, around);
      // a lid shows the image upside down, as seen along its axis from above
      Mask lid = mask_from_bits(0);
      if (g.shape == CYLINDER) lid = g.size[1] - abs(p.z) < g.size[0] - sqrt(p.x * p.x + p.y * p.y);
      right = select(lid, right, around);
      up = select(lid, {zero, -one, zero}, north);
      break;
    }
    case BOX: {
      Float x = abs(p.x) - g.size[0], y = abs(p.y) - g.size[1], z = abs(p.z) - g.size[2];
      Mask face_x = (x >= y) & (x >= z), face_z = (z > x) & (z > y);
      right = select(face_x, up, right);
      up = select(face_z, up, {zero, zero, one});
      break;
    }
    default:  // planes, and meshes on which the image lies as seen from above
      break;
  }
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
