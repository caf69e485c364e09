// The surface at each lane's hit: point, normals, albedo and gloss, gathered geom by geom.

template <int CHANNELS>
struct Patch {
  Vec point, normal;  // camera frame; the normal is unit and faces the ray
  Vec origin;         // where rays that leave the surface start
  float step = 0;     // from point to origin, at most
  Float albedo[CHANNELS];
  Float gloss_tint[CHANNELS];  // a texture colours the gloss too, as in MuJoCo's viewer; else 1
  Float emission, specular, exponent, reflectance, alpha;
  Mask physical;              // GGX lanes; the others are classic: metallic 0
  Float metallic, alpha_ggx;  // alpha_ggx: width of the GGX lobe, roughness squared
  Float f0[CHANNELS];         // specular reflectance at normal incidence
};

inline void texture_of_geom(const Frame& f, const Geom& g, const Surface& s, Vec p, Float footprint,
                            Float* out) {
  const Texture& t = f.textures[s.texture];
  if (t.faces == 1) {
    Float u, v;
    float density;
    on_shape(g, s, p, u, v, density);
    sample(t, f.channels, u, v, splat(0), footprint * density, out);
    return;
  }
  Vec q = unit_point(g, p);
  float third = g.shape == CAPSULE || g.shape == CYLINDER ? g.size[1] : g.size[2];
  bool round = g.shape == SPHERE || g.shape == CAPSULE || g.shape == CYLINDER;
  float second = round ? g.size[0] : g.size[1];
  if (g.shape == SPHERE) third = g.size[0];
  float per_meter =
      g.shape == MESH || g.shape == HFIELD || g.shape == PLANE ? 1.0f : 1.0f / g.size[0];
  if (s.uniform) {
    q = {q.x * g.size[0], q.y * second, q.z * third};
    per_meter = 1.0f;
  }
  Float u, v, major;
  Int face;
  on_cube(q, u, v, face, major);
  sample(t, f.channels, u, v, face, footprint * (0.5f * per_meter) / major, out);
}

// A mesh's normal and texture coordinates, lane by lane.
inline void corners_of(const Mesh& mesh, const Hit& hit, unsigned lanes, Vec& smooth, Vec& flat,
                       Float& u, Float& v, Float& density) {
  alignas(64) float out[9][LANES] = {};
  alignas(64) int triangle[LANES];
  alignas(64) float a[LANES], b[LANES];
  store(triangle, hit.triangle);
  store(a, hit.u);
  store(b, hit.v);
  for (; lanes; lanes &= lanes - 1) {
    int i = first_lane(lanes);
    const Corners& c = mesh.corners[triangle[i]];
    const Triangle& t = mesh.triangles[triangle[i]];
    float wu = a[i], wv = b[i], w = 1.0f - wu - wv;
    out[0][i] = w * c.normal[0].x + wu * c.normal[1].x + wv * c.normal[2].x;
    out[1][i] = w * c.normal[0].y + wu * c.normal[1].y + wv * c.normal[2].y;
    out[2][i] = w * c.normal[0].z + wu * c.normal[1].z + wv * c.normal[2].z;
    out[3][i] = t.normal.x;
    out[4][i] = t.normal.y;
    out[5][i] = t.normal.z;
    out[6][i] = w * c.uv[0][0] + wu * c.uv[1][0] + wv * c.uv[2][0];
    out[7][i] = w * c.uv[0][1] + wu * c.uv[1][1] + wv * c.uv[2][1];
    out[8][i] = c.density;
  }
  smooth = {load(out[0]), load(out[1]), load(out[2])};
  flat = {load(out[3]), load(out[4]), load(out[5])};
  u = load(out[6]);
  v = load(out[7]);
  density = load(out[8]);
}

// A hit in its geom's own frame.
struct Site {
  Vec p, d;             // point, and direction of the ray
  Vec normal, flat;     // unit; flat: of a mesh's triangle itself
  Float u, v, density;  // texture coordinates of a mesh
  bool is_mesh;
};

inline Site site_of(const Frame& f, const Geom& g, const Rays& rays, const Hit& hit,
                    unsigned lanes) {
  Site s = {};
  s.d = to_local(g.rotation, rays.direction);
  s.p = local_origin(g, rays) + s.d * hit.distance;
  s.is_mesh = g.shape == MESH || g.shape == HFIELD;
  if (s.is_mesh) {
    corners_of(f.meshes[g.mesh], hit, lanes, s.normal, s.flat, s.u, s.v, s.density);
    s.flat = normalize(s.flat);
  } else {
    s.normal = normal_of_shape(g, s.p);
  }
  s.normal = normalize(s.normal);
  return s;
}

// Smooth normals may turn away from the ray at a silhouette.
EVS_INLINE Vec facing(Vec normal, Vec direction) {
  return select(dot(normal, direction) > 0.0f, normal * splat(-1.0f), normal);
}

// In: the hits of `lanes`. Out: what is there. `travelled`: distance from the camera to the rays'
// start.
template <int CHANNELS>
Patch<CHANNELS> patch_of(const Frame& f, const Rays& rays, const Hit& hit, unsigned lanes,
                         Float travelled) {
  Patch<CHANNELS> out = {};
  out.point = rays.origin + rays.direction * hit.distance;
  out.origin = out.point;
  Float reach = f.orthographic ? splat(f.pixel_angle) : (travelled + hit.distance) * f.pixel_angle;
  while (lanes) {
    int index = lane(hit.geom, first_lane(lanes));
    Mask here = (hit.geom == splat(index)) & mask_of(lanes);
    lanes &= ~bits(here);
    const Geom& g = f.geoms[index];
    const Surface& s = f.surfaces[g.surface];
    auto [p, d, n, flat, mesh_u, mesh_v, mesh_density, is_mesh] =
        site_of(f, g, rays, hit, bits(here));
    // seen at a slant the footprint stretches: take the mean of its two widths
    Float slant = max(abs(dot(n, d)), splat(0.02f));
    Float footprint = reach / sqrt(slant);
    Float texel[CHANNELS];
    if (s.texture >= 0) {
      if (is_mesh && f.meshes[g.mesh].has_texcoords && f.textures[s.texture].faces == 1) {
        float ru = s.repeat[0] * (s.uniform && g.size[0] > 0 ? g.size[0] : 1.0f);
        float rv = s.repeat[1] * (s.uniform && g.size[1] > 0 ? g.size[1] : 1.0f);
        sample(f.textures[s.texture], CHANNELS, mesh_u * ru, mesh_v * rv, splat(0),
               footprint * mesh_density * (ru > rv ? ru : rv), texel);
      } else {
        texture_of_geom(f, g, s, p, footprint, texel);
      }
    }
    for (int c = 0; c < CHANNELS; c++) {
      out.albedo[c] = select(here, s.texture >= 0 ? texel[c] : splat(s.albedo[c]), out.albedo[c]);
      out.gloss_tint[c] = select(here, s.texture >= 0 ? texel[c] : splat(1.0f), out.gloss_tint[c]);
    }
    out.normal = select(here, to_camera(g.rotation, n), out.normal);
    if (is_mesh) {
      // step off the triangle: far enough for the rounding of hit point and mesh, no further
      Float step = (travelled + hit.distance) * 2e-5f + f.bounds.radius[index] * 1e-5f;
      out.origin = select(here, out.point + to_camera(g.rotation, flat) * step, out.origin);
      float longest = highest(select(here, step, splat(0.0f)));
      out.step = longest > out.step ? longest : out.step;
    }
    out.emission = select(here, splat(s.emission), out.emission);
    out.specular = select(here, splat(s.specular), out.specular);
    out.exponent = select(here, splat(s.exponent), out.exponent);
    out.reflectance = select(here, splat(s.reflectance), out.reflectance);
    out.alpha = select(here, splat(s.alpha), out.alpha);
    out.alpha_ggx = select(here, splat(s.alpha_ggx), out.alpha_ggx);
    out.metallic = select(here, splat(s.metallic), out.metallic);
    if (s.physical) out.physical = out.physical | here;
    for (int c = 0; c < CHANNELS; c++) {
      Float f0 = splat(s.f0);
      if (s.physical) f0 = 0.04f + (out.albedo[c] - 0.04f) * out.metallic;
      out.f0[c] = select(here, f0, out.f0[c]);
    }
  }
  out.normal = facing(out.normal, rays.direction);
  return out;
}
