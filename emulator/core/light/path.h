// The `path` integrator: at each point of a path every light is asked at first and one of them
// later, glowing geoms and the sky are aimed at and also found by chance (multiple importance
// sampling, balance heuristic), and the path goes on in one direction that the surface draws.

// Which numbers a point of a path draws. Each light of the first point has its own after the last.
enum Draw {
  DRAW_PIXEL = 0,
  DRAW_PASS,
  DRAW_LOBE,
  DRAW_DIRECTION,
  DRAW_AIM,
  DRAW_PLACE,
  DRAW_LIGHT
};
constexpr int DRAWS = 1 << 20;  // of one point; the last are those of transparent layers

constexpr int SURE_BOUNCES = 2;  // after these a path ends by chance

// What share of the light arrives from `towards` of what is less than `limit` away.
inline Float visibility(const Frame& f, const PathFrame& p, Vec origin, Vec towards, Float limit,
                        Int self, Mask wanted, Clearance* clearance) {
  if (clearance) note(*clearance, origin, towards, limit, wanted);
  Hull hull = hull_of(origin, towards, wanted, FAR);
  Float zero = splat(0.0f), one = splat(1.0f);
  if (!p.transparent) {
    return select(occluded(f, origin, towards, limit, self, hull, wanted, 0) | ~wanted, zero, one);
  }
  Float passing = select(wanted, one, zero), beyond = zero;
  Rays rays = {origin, towards, false};
  for (int layer = 0; layer < MAX_LAYERS && any(wanted); layer++) {
    Hit hit = closest(f, rays, hull, wanted, beyond);
    wanted = wanted & (hit.distance < limit) & ~(hit.geom < splat(0));
    if (!any(wanted)) return passing;
    Patch<3> patch = patch_of<3>(f, rays, hit, bits(wanted), zero);
    passing = select(wanted, passing * max(1.0f - patch.alpha, zero), passing);
    wanted = wanted & (passing > 0.0f);
    beyond = hit.distance;
  }
  return select(wanted, zero, passing);  // more layers than are followed: dark
}

// The light of MuJoCo's lights that leaves the surface along -d, each weighed by `weight`.
inline void add_light(const Frame& f, const PathFrame& p, const Scattering& s, Vec d,
                      const Patch<3>& patch, Int self, Mask lit, const Light& light, Pair place,
                      Float weight, Clearance* clearance, Float* out) {
  Incidence in = incidence(light, patch.point);
  if (light.radius > 0 && light.kind != DIRECTIONAL) {
    // a bulb: as much light as a glowing ball gives, from somewhere on it
    Float square = in.distance * in.distance, reach;
    Mask outside = in.distance > light.radius;
    Vec towards = into_cone(in.towards, in.distance, light.radius, place, reach);
    Float share =
        2.0f * opening(square, light.radius) * square * (1.0f / (light.radius * light.radius));
    in.towards = select(outside, towards, in.towards);
    in.distance = select(outside, max(reach, splat(0.0f)), in.distance);
    in.strength = select(outside, in.strength * share, in.strength);
  }
  Mask facing = lit & (dot(in.towards, s.normal) > 0.0f) & (dot(in.towards, patch.flat) > 0.0f) &
                (in.strength > 0.0f) & (weight > 0.0f);
  if (!any(facing)) return;
  Float arrives = select(facing, splat(1.0f), splat(0.0f));
  if (light.castshadow && f.shadows) {
    arrives = visibility(f, p, patch.origin, in.towards, in.distance, self, facing, clearance);
    facing = facing & (arrives > 0.0f);
    if (!any(facing)) return;
  }
  Value v = evaluate(s, d, in.towards);
  // a light of diffuse E gives Lambert's surface the radiance albedo E: its irradiance is pi E
  Float scale = arrives * weight * in.strength * PI;
  for (int c = 0; c < 3; c++) {
    out[c] = out[c] + select(facing, v.light[c] * scale * light.diffuse[c], splat(0.0f));
  }
}

// Light of `lanes` that was met with `carried` left of it: times `weight`.
EVS_INLINE void add_seen(const Float* carried, const Float* light, Float weight, Mask lanes,
                         Float* out) {
  for (int c = 0; c < 3; c++) {
    out[c] = select(lanes, out[c] + carried[c] * light[c] * weight, out[c]);
  }
}

// The sky's light of rays that a surface scattered with `density`, weighed against aiming at it.
// `arrives`: what share gets through.
inline void add_sky(const Frame& f, const PathFrame& p, Vec d, Mask sure, Float density,
                    const Float* carried, Float arrives, Mask lanes, Float* out) {
  SkyPlace at = on_sky(f, d);
  Float light[3], aimed = sky_density(p, at);
  sky_light(f, p, at, select(sure, splat(FAR), density), bits(lanes), light);
  Float weight = select(sure, splat(1.0f), density / max(density + aimed, splat(1e-30f)));
  add_seen(carried, light, weight * arrives, lanes, out);
}

// Light of one sample along each ray of `active`. `first`: the hull of the rays; `clearance`: which
// learns of every ray, or null. Out: how far away the first surface is, FAR where there is none.
inline Float follow_path(const Frame& f, const PathFrame& p, Rays rays, const Hull& first,
                         Sampler sampler, Mask active, Clearance* clearance, Float* out) {
  Float zero = splat(0.0f), one = splat(1.0f);
  Float carried[3] = {one, one, one};
  for (int c = 0; c < 3; c++) out[c] = zero;
  Float travelled = zero, density = zero, away = splat(FAR);
  Mask sure = active;    // found in no other way: camera and mirror rays
  Int left = splat(-1);  // the geom that the rays come from
  for (int point = 0;; point++) {
    int draws = point * DRAWS;
    if (point > p.bounces && !p.glowing) {
      // the last rays can meet the sky or nothing
      if (!p.open) return away;
      Float arrives =
          visibility(f, p, rays.origin, rays.direction, splat(FAR), left, active, clearance);
      active = active & (arrives > 0.0f);
      if (any(active)) {
        add_sky(f, p, rays.direction, sure, density, carried, arrives, active, out);
      }
      return away;
    }
    Hull hull = point == 0 ? first : hull_of(rays.origin, rays.direction, active, FAR);
    Hit hit = closest(f, rays, hull, active, zero);
    Mask lit = active & ~(hit.geom < splat(0));
    Patch<3> patch = patch_of<3>(f, rays, hit, bits(lit), travelled);
    if (p.transparent) {
      // what a transparent surface lets pass goes on to the next one
      Mask passing = mask_of(0);
      for (int layer = 0; layer < MAX_LAYERS; layer++) {
        Float chance = pair_of(sampler, draws + DRAWS - 1 - layer).x;
        Mask through =
            layer == 0 ? lit & ~(chance < patch.alpha) : passing & lit & ~(chance < patch.alpha);
        if (!any(through)) break;
        passing = through;
        Hit next = closest(f, rays, hull, through, hit.distance);
        Mask found = through & ~(next.geom < splat(0));
        lit = (lit & ~through) | found;
        hit = {select(through, next.distance, hit.distance), select(through, next.geom, hit.geom),
               select(through, next.triangle, hit.triangle), select(through, next.u, hit.u),
               select(through, next.v, hit.v)};
        patch = patch_of<3>(f, rays, hit, bits(lit), travelled);
      }
    }

    if (clearance) {
      Float end = select(lit, hit.distance, splat(FAR));
      note(*clearance, rays.origin, rays.direction, end, active);
    }
    if (point == 0 && sampler.mode == SAMPLES_ANCHORED) {
      sampler.pixel = anchor_of(f, rays, hit, lit);
    }

    Mask missed = active & ~lit;
    if (any(missed) && p.open) {
      Float light[3];
      if (point == 0) {
        for (int c = 0; c < 3; c++) light[c] = zero;
        if (f.skybox >= 0) sky<3>(f, rays.direction, bits(missed), light);
        add_seen(carried, light, one, missed, out);
      } else {
        add_sky(f, p, rays.direction, sure, density, carried, one, missed, out);
      }
    }
    if (point == 0) away = select(lit, hit.distance, away);
    if (!any(lit)) return away;

    Mask glowing = lit & (patch.emitted[0] + patch.emitted[1] + patch.emitted[2] > 0.0f);
    if (any(glowing)) {
      Float weight = one;
      if (any(glowing & ~sure)) {
        Float aimed = density_of_hit(f, p, rays, hit, patch, bits(glowing & ~sure));
        weight = select(sure, one, density / max(density + aimed, splat(1e-30f)));
      }
      add_seen(carried, patch.emitted, weight, glowing, out);
    }
    if (point > p.bounces) return away;

    Scattering s = scattering_of(patch, rays.direction);
    Float received[3] = {zero, zero, zero};
    // MuJoCo's lights: all of them at first, then one
    int count = p.lamp_count;
    if (point == 0) {
      for (int i = 0; i < f.light_count; i++) {
        if (f.lights[i].kind == IMAGE) continue;
        Pair place = {zero, zero};
        if (f.lights[i].radius > 0) place = pair_of(sampler, draws + DRAW_LIGHT + 1 + i);
        add_light(f, p, s, rays.direction, patch, hit.geom, lit, f.lights[i], place, one, clearance,
                  received);
      }
    } else if (count > 0) {
      Float chance = pair_of(sampler, draws + DRAW_LIGHT).x * static_cast<float>(count);
      Pair place = pair_of(sampler, draws + DRAW_LIGHT + 1);
      Int chosen = truncate(chance);
      for (int i = 0, lamp = 0; i < f.light_count; i++) {
        if (f.lights[i].kind == IMAGE) continue;
        Mask here = lit & (chosen == splat(lamp++));
        if (!any(here)) continue;
        add_light(f, p, s, rays.direction, patch, hit.geom, here, f.lights[i], place,
                  splat(static_cast<float>(count)), clearance, received);
      }
    }
    // glowing geoms and the sky
    if (p.emitter_count > 0 || p.sky_share > 0) {
      Pair choice = pair_of(sampler, draws + DRAW_AIM),
           place = pair_of(sampler, draws + DRAW_PLACE);
      Mask to_sky = lit & (choice.x < p.sky_share);
      Mask to_emitter = lit & ~to_sky;
      Aim aim = {s.normal, zero, {zero, zero, zero}, zero};
      SkyPlace aimed;
      if (p.emitter_count > 0 && any(to_emitter)) {
        aim = aim_at_emitter(f, p, patch.origin, choice.y, place, to_emitter,
                             travelled + hit.distance);
      }
      if (any(to_sky)) {
        Aim sky = aim_at_sky(f, p, place, aimed);
        aim.towards = select(to_sky, sky.towards, aim.towards);
        aim.distance = select(to_sky, sky.distance, aim.distance);
        aim.density = select(to_sky, sky.density, aim.density);
      }
      Value v = evaluate(s, rays.direction, aim.towards);
      to_sky = to_sky & (v.density > 0.0f);
      if (any(to_sky)) {
        Float light[3];
        sky_light(f, p, aimed, v.density, bits(to_sky), light);
        for (int c = 0; c < 3; c++) aim.light[c] = select(to_sky, light[c], aim.light[c]);
      }
      Mask facing =
          lit & (aim.density > 0.0f) & (v.density > 0.0f) & (dot(aim.towards, patch.flat) > 0.0f);
      if (any(facing)) {
        // up to the glowing surface, not into it
        Float limit = aim.distance * 0.9999f;
        Float arrives =
            visibility(f, p, patch.origin, aim.towards, limit, hit.geom, facing, clearance);
        Float weight = arrives / (v.density + aim.density);
        for (int c = 0; c < 3; c++) {
          received[c] = received[c] + select(facing, v.light[c] * aim.light[c] * weight, zero);
        }
      }
    }
    for (int c = 0; c < 3; c++) out[c] = select(lit, out[c] + carried[c] * received[c], out[c]);

    // onwards
    Pair lobe = pair_of(sampler, draws + DRAW_LOBE), way = pair_of(sampler, draws + DRAW_DIRECTION);
    Scattered next = scatter(s, rays.direction, lobe, way);
    active = lit & next.alive & (dot(next.direction, patch.flat) > 0.0f);
    Float most = zero;
    for (int c = 0; c < 3; c++) {
      carried[c] = carried[c] * next.throughput[c];
      most = max(most, carried[c]);
    }
    active = active & (most > 0.0f);
    if (point >= SURE_BOUNCES) {
      Float survives = min(most, splat(0.95f));
      active = active & (pair_of(sampler, draws + DRAW_PASS).y < survives);
      Float inverse = 1.0f / max(survives, splat(1e-20f));
      for (int c = 0; c < 3; c++) carried[c] = carried[c] * inverse;
    }
    if (!any(active)) return away;
    sure = next.mirrored;
    density = next.density;
    travelled = travelled + hit.distance;
    left = hit.geom;
    rays = {patch.origin, next.direction, false};
  }
}

// Haze in front of what is `away`.
EVS_INLINE void veil(const Frame& f, Vec direction, Float away, Float* light) {
  Float curtain, cover = haze(f, direction, curtain);
  for (int c = 0; c < 3; c++) {
    Float hazy = light[c] + (f.air.haze_color[c] - light[c]) * cover;
    light[c] = select(away > curtain, hazy, light[c]);
  }
}

constexpr int SUM_BLOCK = 64;  // sums of sums, so that thousands of samples do not round away

// Light of the sampler's sample of 16 pixels, and of the air in front of it. `hull` null: pixels
// from anywhere, whose rays have a wide one.
inline void trace_sample(const Frame& f, const PathFrame& p, const Sampler& sampler, Int column,
                         Int row, const Hull* hull, Mask active, Clearance* clearance,
                         Float* light) {
  Pair in_pixel = pair_of(sampler, DRAW_PIXEL);
  Rays rays = rays_through(f, to_float(column) + in_pixel.x, to_float(row) + in_pixel.y);
  Hull own = hull ? *hull : hull_of(rays.origin, rays.direction, active, FAR);
  Float away = follow_path(f, p, rays, own, sampler, active, clearance, light);
  if (f.air.fog) fog<3>(f, away, light);
  if (f.air.haze) veil(f, rays.direction, away, light);
}

// Mean of all samples of 16 pixels.
inline void trace_paths(const Frame& f, const PathFrame& p, const int* x, const int* y,
                        const Hull* hull, Float* mean) {
  Int column = load(x), row = load(y);
  Sampler sampler = {row * splat(f.width) + column, p.sample_set, p.seed, 0, p.digits};
  Float sum[3], part[3];
  for (int c = 0; c < 3; c++) sum[c] = part[c] = splat(0.0f);
  for (int s = 0; s < f.samples; s++) {
    sampler.index = s;
    Float light[3];
    trace_sample(f, p, sampler, column, row, hull, mask_of(0xffff), nullptr, light);
    bool full = s % SUM_BLOCK == SUM_BLOCK - 1 || s == f.samples - 1;
    for (int c = 0; c < 3; c++) {
      part[c] = part[c] + light[c];
      if (full) {
        sum[c] = sum[c] + part[c];
        part[c] = splat(0.0f);
      }
    }
  }
  for (int c = 0; c < 3; c++) mean[c] = sum[c] * (1.0f / static_cast<float>(f.samples));
}

void trace_path(const Frame& f, const PathFrame& p, int column, int row, const Outputs& out) {
  alignas(64) int x[LANES], y[LANES];
  for (int i = 0; i < LANES; i++) {
    x[i] = column * PACKET_WIDTH + i % PACKET_WIDTH;
    y[i] = row * PACKET_HEIGHT + i / PACKET_WIDTH;
  }
  Float mean[3];
  trace_paths(f, p, x, y, &f.primary[row * f.packet_columns + column], mean);
  write_pixels<3>(f, column, row, luminance_of<3>(f, mean), mean, out);
}

void trace_path_pixels(const Frame& f, const PathFrame& p, const int32_t* x, const int32_t* y,
                       int count, float* luminance) {
  alignas(64) int column[LANES], row[LANES];
  fill_lanes(x, y, count, column, row);
  Float mean[3];
  trace_paths(f, p, column, row, nullptr, mean);
  alignas(64) float out[LANES];
  store(out, luminance_of<3>(f, mean));
  for (int i = 0; i < count; i++) {
    luminance[i] = shaded(f, static_cast<long>(row[i]) * f.width + column[i], out[i]);
  }
}
