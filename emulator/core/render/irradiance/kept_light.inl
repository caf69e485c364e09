// What a packet keeps under a still camera: all that its light is made of but for the light of the
// cache's nodes, which changes in every tick; and while lamps move, the surfaces that they light.
// Shading it again then takes neither camera rays nor textures.
#pragma once

#include "render/integrators/film.inl"
#include "render/irradiance/node_lattice.inl"
#include "render/shading/bsdf.inl"

namespace evs::EVS_NAMESPACE {
namespace {

// Rows of a sample: 16 numbers each.
constexpr int KEPT_HEAD = 0;    // KeptHead
constexpr int KEPT_SHARE = 1;   // of the second cells
constexpr int KEPT_CELLS = 2;   // x, y and four nodes' places in KeptNodes, a byte each; twice
constexpr int KEPT_WEIGHT = 8;  // of the surface, in front of what shines through haze
constexpr int KEPT_LIGHT = 9;   // by channel: light of lamps, reflectance, mirror image, haze

struct KeptHead {
  uint32_t lit, mirrors, blended;  // lanes, one bit each
  uint32_t layered;                // not 0: weight and haze count
  float step;                      // of the surface
};

// Rows of a sample's surface: distance, geom, point, origin of rays, normal, geometric normal,
// width of the specular lobe, below 0 where it is a classic surface's; by channel diffuse and
// specular reflectance, emitted light.
constexpr int SURFACE_CHANNELS = 15;

template <int CHANNELS>
struct SurfaceLobes {
  Bsdf geometry;  // normal, direction and width; no colour
  Float specular[CHANNELS], diffuse[CHANNELS];
};

EVS_INLINE Bsdf lobe_geometry(Vec normal, Vec d, Float alpha, Mask physical) {
  Bsdf s;
  s.normal = normal;
  s.physical = physical;
  s.cos_outgoing = max(-dot(d, normal), splat(1e-4f));
  s.alpha = min(max(alpha, splat(0.002f)), splat(1.0f));
  return s;
}

// The lobes of `make_bsdf`, in any number of channels.
template <int CHANNELS>
SurfaceLobes<CHANNELS> surface_lobes(const SurfaceInteraction<CHANNELS>& interaction, Vec d) {
  SurfaceLobes<CHANNELS> s;
  s.geometry = lobe_geometry(interaction.normal, d, interaction.alpha_ggx, interaction.physical);
  Float mirror = min(max(interaction.reflectance, splat(0.0f)), splat(1.0f));
  Float rest = beside_mirror(mirror, interaction.physical);
  for (int c = 0; c < CHANNELS; c++) {
    Float f0 = min(max(interaction.f0[c], splat(0.0f)), splat(1.0f));
    s.specular[c] = rest * f0;
    s.diffuse[c] = rest * max(interaction.albedo[c], splat(0.0f)) * (1.0f - interaction.metallic) *
                   (1.0f - f0);
  }
  return s;
}

// What lamps light.
template <int CHANNELS>
struct KeptSurface {
  Hit hit;
  SurfaceInteraction<CHANNELS> interaction;
  SurfaceLobes<CHANNELS> lobes;
};

// Writes the samples of a packet one by one, or of its refined pixels the nodes alone.
struct KeptWriter {
  float* sample;   // the next one; null: keep none
  float* surface;  // the next one; null: keep none
  KeptNodes* nodes;
  bool complete = true;
  int surfaces = 0;  // shaded for it so far
  int channels = 0;
  KeptHead head = {};

  float* row(int i) const { return sample + i * PACKET; }
  float* light(int kind, int c) const { return row(KEPT_LIGHT + kind * channels + c); }

  // A surface in `lit`: only the first one may read the cache, and nothing shines through it.
  template <int CHANNELS>
  void shaded(const CacheCells& cells, const Float* lamps, const Float* reflectance, const Hit& hit,
              const SurfaceInteraction<CHANNELS>& at, const SurfaceLobes<CHANNELS>& lobes,
              Mask lit) {
    channels = CHANNELS;
    complete = complete && surfaces++ == 0 && !any(lit & (at.alpha < 1.0f));
    if (!complete) return;
    if (!sample) {
      keep_nodes(cells.first, lit);
      keep_nodes(cells.second, cells.blended);
      return;
    }
    head = {to_bits(lit), 0, to_bits(cells.blended), 0, at.step};
    if (surface) keep_surface<CHANNELS>(hit, at, lobes);
    store(row(KEPT_SHARE), cells.share);
    keep_cells(cells.first, KEPT_CELLS, lit);
    keep_cells(cells.second, KEPT_CELLS + 3, cells.blended);
    for (int c = 0; c < CHANNELS; c++) {
      store(light(0, c), lamps[c]);
      store(light(1, c), reflectance[c]);
    }
  }
  template <int CHANNELS>
  void keep_surface(const Hit& hit, const SurfaceInteraction<CHANNELS>& at,
                    const SurfaceLobes<CHANNELS>& lobes) {
    float* to = surface;
    auto put = [&to](Float x) {
      store(to, x);
      to += PACKET;
    };
    put(hit.distance);
    put(as_float(hit.geom));
    const Vec* const vectors[] = {&at.point, &at.spawn_point, &at.normal, &at.geometric_normal};
    for (const Vec* v : vectors) put(v->x), put(v->y), put(v->z);
    put(select(lobes.geometry.physical, lobes.geometry.alpha, -lobes.geometry.alpha));
    const Float* const colours[] = {lobes.diffuse, lobes.specular, at.emitted};
    for (const Float* colour : colours) {
      for (int c = 0; c < CHANNELS; c++) put(colour[c]);
    }
  }
  void keep_cells(const CellLanes& cells, int first, Mask lanes) {
    store(row(first), cells.x);
    store(row(first + 1), cells.y);
    store(row(first + 2), as_float(keep_nodes(cells, lanes)));
  }
  Int keep_nodes(const CellLanes& cells, Mask lanes) {
    Int places = splat(0);
    for (int k = 3; k >= 0; k--) {
      places = places * splat(256);
      for (unsigned left = to_bits(lanes); left;) {
        int node = lane(cells.node[k], first_lane(left)), place = nodes->add(node);
        Mask here = (cells.node[k] == splat(node)) & mask_from_bits(left);
        left &= ~to_bits(here);
        complete = complete && place >= 0;
        places = select(here, places + splat(place), places);
      }
    }
    return places;
  }
  // A mirror image that reads nothing, in `lanes`.
  template <int CHANNELS>
  void mirrored(const Float* image, Mask lanes) {
    if (!sample || !complete || surfaces != 1) return;
    head.mirrors = to_bits(lanes);
    for (int c = 0; c < CHANNELS; c++) store(light(2, c), image[c]);
  }
  // How the surface is composited: over light that is in front of it, and that of lanes that miss.
  template <int CHANNELS>
  void composited(const Float* before, Float weight, Mask lit) {
    if (!sample || !complete || surfaces != 1) return;
    Mask plain = lit & (weight >= 1.0f);
    for (int c = 0; c < CHANNELS; c++) {
      plain = plain & (before[c] <= 0.0f) & (before[c] >= 0.0f);
      store(light(3, c), before[c]);
    }
    head.layered = to_bits(plain) != ALL_LANES;
    store(row(KEPT_WEIGHT), weight);
  }
  // The end of a sample, with all of its light.
  template <int CHANNELS>
  void sampled(const Float* total) {
    if (!sample) {
      surfaces = 0;
      return;
    }
    channels = CHANNELS;
    if (surfaces == 0) {
      head = {0, 0, 0, 1, 0};
      for (int c = 0; c < CHANNELS; c++) store(light(3, c), total[c]);
    }
    __builtin_memcpy(sample, &head, sizeof head);
    surfaces = 0;
    sample += kept_rows(CHANNELS) * PACKET;
    if (surface) surface += surface_rows(CHANNELS) * PACKET;
  }
};

// Which channel holds what: red, green and blue are `colour` ... `colour` + 2, all others are
// luminance.
template <int CHANNELS>
EVS_INLINE Float of_channel(const Frame& f, const Received& light, int c) {
  int k = c - f.colour;
  bool colour = CHANNELS >= 3 && k >= 0 && k < 3;
  return colour ? light.colour[k < 0 || k > 2 ? 0 : k] : light.luminance;
}

template <int CHANNELS>
void read_surface(const float* rows, float step, Vec direction, KeptSurface<CHANNELS>& to) {
  auto get = [&rows] {
    Float x = load(rows);
    rows += PACKET;
    return x;
  };
  to.hit.distance = get();
  to.hit.geom = as_int(get());
  SurfaceInteraction<CHANNELS>& at = to.interaction;
  Vec* const vectors[] = {&at.point, &at.spawn_point, &at.normal, &at.geometric_normal};
  for (Vec* v : vectors) v->x = get(), v->y = get(), v->z = get();
  at.step = step;
  Float width = get();
  at.alpha_ggx = abs(width);
  at.physical = width > 0.0f;
  Float* const colours[] = {to.lobes.diffuse, to.lobes.specular, at.emitted};
  for (Float* colour : colours) {
    for (int c = 0; c < CHANNELS; c++) colour[c] = get();
  }
  to.lobes.geometry = lobe_geometry(at.normal, direction, at.alpha_ggx, at.physical);
}

// The light of a packet with what it has kept, as trace_hybrid finds it. In: lamps(sample, step,
// lit, light), the light of lamps, or null where it is kept.
template <int CHANNELS, class Lamps>
void relight_kept(const Frame& f, const IrradianceView& cache, int column, int row,
                  const Outputs& out, const KeptNodes& nodes, float* rows, const Lamps* lamps) {
  // the light of its nodes, side by side
  alignas(64) float near[4 * KeptNodes::ROOM];
  for (int k = 0; k < nodes.count; k++)
    __builtin_memcpy(near + 4 * k, cache.light + 4L * nodes.node[k], 4 * sizeof(float));
  Float sum = splat(0.0f), sums[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) sums[c] = sum;
  for (int s = 0; s < f.samples; s++, rows += kept_rows(CHANNELS) * PACKET) {
    auto kept = [rows](int i) { return load(rows + i * PACKET); };
    auto of = [&](int kind, int c) { return kept(KEPT_LIGHT + kind * CHANNELS + c); };
    KeptHead head;
    __builtin_memcpy(&head, rows, sizeof head);
    Mask lit = mask_from_bits(head.lit), mirror = mask_from_bits(head.mirrors);
    Float light[CHANNELS];
    if (head.lit) {
      if (lamps) {
        (*lamps)(s, head.step, lit, light);
        for (int c = 0; c < CHANNELS; c++) store(rows + (KEPT_LIGHT + c) * PACKET, light[c]);
      }
      auto cells = [&](int i) {
        Int places = as_int(kept(i + 2)), byte = splat(255);
        return CellLanes{{places & byte, shift_right<8>(places) & byte,
                          shift_right<16>(places) & byte, shift_right<24>(places) & byte},
                         kept(i),
                         kept(i + 1)};
      };
      CacheCells at;
      at.first = cells(KEPT_CELLS);
      at.blended = mask_from_bits(head.blended);
      at.share = splat(0.0f);
      if (head.blended) {
        at.share = kept(KEPT_SHARE);
        at.second = cells(KEPT_CELLS + 3);
      }
      Received received = {};
      read_cells<(CHANNELS >= 3)>(near, at, lit, received);
      for (int c = 0; c < CHANNELS; c++)
        light[c] = of(0, c) + of(1, c) * of_channel<CHANNELS>(f, received, c);
      for (int c = 0; c < CHANNELS && head.mirrors; c++)
        light[c] = select(mirror, light[c] + of(2, c), light[c]);
    }
    for (int c = 0; c < CHANNELS; c++) {
      if (!head.layered) {
        light[c] = splat(0.0f) + light[c];
      } else if (head.lit) {
        light[c] = select(lit, of(3, c) + light[c] * kept(KEPT_WEIGHT), of(3, c));
      } else {
        light[c] = of(3, c);
      }
      if (out.rgb || out.untextured) sums[c] = sums[c] + light[c];
    }
    sum = sum + luminance_of<CHANNELS>(f, light);
  }
  float share = 1.0f / static_cast<float>(f.samples);
  for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] * share;
  write_pixels<CHANNELS>(f, column, row, sum * share, sums, out);
}

}  // namespace
}  // namespace evs::EVS_NAMESPACE
