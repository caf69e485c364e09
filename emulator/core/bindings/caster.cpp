// The caster's Python binding. It checks the shape of every array; the code behind it relies on
// that.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <tuple>

#include "bindings/bound_caster.h"
#include "bindings/gil.h"
#include "render/seed_cycle.h"

namespace nb = nanobind;

namespace evs {
namespace {

using Rgb = std::array<float, 3>;

Optics* make_optics(int width, int height, double fx, double fy, double cx, double cy,
                    bool orthographic, std::optional<In<float, N, N, 3>> lens,
                    std::optional<In<float, N, N>> share, double near, bool near_sphere) {
  require(near >= 0 && std::isfinite(near), "a near plane lies before the camera");
  require(width > 0 && height > 0, "an image has pixels");
  require(fx > 0 && fy > 0 && std::isfinite(fx) && std::isfinite(fy) && std::isfinite(cx) &&
              std::isfinite(cy),
          "focal lengths are positive and finite");
  size_t w = static_cast<size_t>(width), h = static_cast<size_t>(height);
  Optics optics = {width, height, fx, fy, cx, cy, orthographic};
  optics.near = near;
  optics.near_sphere = near_sphere;
  if (lens) {
    require(lens->shape(0) == h + 1 && lens->shape(1) == w + 1,
            "the lens is (height + 1, width + 1, 3)");
    // its size must fit into 32 bits
    require(lens->size() < (1u << 31) && !orthographic, "a lens bends the rays of a perspective");
    optics.lens.assign(lens->data(), lens->data() + lens->size());
    for (size_t i = 0; i < optics.lens.size(); i += 3) {
      double x = optics.lens[i], y = optics.lens[i + 1], z = optics.lens[i + 2];
      double square = x * x + y * y + z * z;
      require(square > 1e-12 && square < 1e12, "every ray has a direction");
    }
  }
  if (share) {
    require(share->shape(0) == h && share->shape(1) == w, "the share of light is (height, width)");
    optics.share.assign(share->data(), share->data() + share->size());
    for (float part : optics.share)
      require(part >= 0 && std::isfinite(part), "a share is not negative");
  }
  return new Optics(optics);
}

Tracing* make_tracing(int samples, bool adaptive, bool shadows, bool incremental, bool rgb,
                      const std::string& integrator, int bounces, const std::string& sample_set,
                      int block, int blocks, int nodes, const FeatureFlags& forced) {
  require(samples >= 1 && samples <= 4096, "samples: 1 ... 4096");
  bool path = integrator == "path", hybrid = integrator == "hybrid";
  require(path || hybrid || integrator == "direct", "the integrator is direct, hybrid or path");
  require(bounces >= 0 && bounces <= 1000, "bounces: 0 ... 1000");
  require(nodes >= 0, "nodes: 0 or more");
  require(blocks >= 1 && blocks <= 64 && block >= 0 && block < blocks, "blocks: 1 ... 64");
  return new Tracing{samples,
                     adaptive,
                     shadows,
                     incremental,
                     rgb,
                     path,
                     hybrid,
                     bounces,
                     sample_set_of(sample_set),
                     nodes,
                     block,
                     blocks,
                     ForcedFeatures(forced)};
}

void set_geoms(SceneData& s, In<int32_t, N> type, In<float, N, 3> size, In<int32_t, N> mesh,
               In<int32_t, N> surface) {
  size_t n = type.shape(0);
  require(size.shape(0) == n && mesh.shape(0) == n && surface.shape(0) == n,
          "geom arrays differ in length");
  for (size_t i = 0; i < n; i++) {
    int t = type.data()[i];
    require(t >= PLANE && t <= MESH, "unknown geom type");
    int m = mesh.data()[i], u = surface.data()[i];
    require(t != MESH && t != HFIELD ? true : m >= 0 && m < static_cast<int>(s.meshes.size()),
            "geom's mesh does not exist");
    require(u >= 0 && u < static_cast<int>(s.surfaces.size()), "geom's surface does not exist");
  }
  s.geom_type.assign(type.data(), type.data() + n);
  s.geom_mesh.assign(mesh.data(), mesh.data() + n);
  s.geom_surface.assign(surface.data(), surface.data() + n);
  s.geom_size.assign(size.data(), size.data() + 3 * n);
}

void add_mesh(SceneData& s, In<float, N, 3> vertices, In<int32_t, N, 3> faces,
              std::optional<In<float, N, 3, 3>> normals,
              std::optional<In<float, N, 3, 2>> texcoords) {
  require(!normals || normals->shape(0) == faces.shape(0),
          "one normal for each corner of each face");
  require(!texcoords || texcoords->shape(0) == faces.shape(0),
          "one texture coordinate for each corner of each face");
  s.meshes.push_back(std::make_shared<SceneData::MeshData>(
      make_mesh(vertices.data(), static_cast<int>(vertices.shape(0)), faces.data(),
                static_cast<int>(faces.shape(0)), normals ? normals->data() : nullptr,
                texcoords ? texcoords->data() : nullptr)));
}

void share_mesh(SceneData& s, const BoundCaster& caster, int mesh) {
  require(mesh >= 0 && mesh < caster.caster.mesh_count(), "the mesh does not exist");
  s.meshes.push_back(caster.caster.shared_mesh(mesh));
}

int add_texture(SceneData& s, In<uint8_t, N, N, N, N> data, bool srgb, int like) {
  int faces = static_cast<int>(data.shape(0)), c = static_cast<int>(data.shape(3));
  require(faces == 1 || faces == 6, "a texture has 1 or 6 faces");
  require(c == 1 || c == 3 || c == 4, "a texture has 1, 3 or 4 components");
  require(data.shape(1) > 0 && data.shape(2) > 0, "a texture has texels");
  // texel indices have 32 bits; the mip levels are a third more
  require(data.shape(1) < (1u << 15) && data.shape(2) < (1u << 15) &&
              data.shape(0) * data.shape(1) * data.shape(2) < (1u << 30),
          "a texture is smaller than 32768 x 32768 and has fewer than 2^30 texels");
  s.textures.push_back({{data.data(), data.data() + data.size()},
                        faces,
                        static_cast<int>(data.shape(1)),
                        static_cast<int>(data.shape(2)),
                        c,
                        srgb,
                        like});
  return static_cast<int>(s.textures.size()) - 1;
}

void add_surface(SceneData& s, std::array<float, 4> rgba, int texture, std::array<float, 2> repeat,
                 bool uniform, float emission, float specular, float shininess, float reflectance,
                 float metallic, float roughness, std::array<int, 6> maps) {
  int textures = static_cast<int>(s.textures.size());
  require(texture < textures, "surface's texture does not exist");
  for (int map : maps) require(map < textures, "surface's map does not exist");
  for (int i = 0; i < 4; i++) {
    require(maps[i] < 0 || s.textures[maps[i]].components == 1, "such a map has one component");
  }
  require(maps[4] < 0 || s.textures[maps[4]].components >= 3, "a normal map has three components");
  SceneData::SurfaceData d = {};
  std::copy(rgba.begin(), rgba.end(), d.rgba);
  std::copy(repeat.begin(), repeat.end(), d.repeat);
  d.texture = texture;
  d.uniform = uniform;
  d.emission = emission;
  d.specular = specular;
  d.shininess = shininess;
  d.reflectance = reflectance;
  d.metallic = metallic;
  d.roughness = roughness;
  d.metallic_map = maps[0];
  d.roughness_map = maps[1];
  d.occlusion_map = maps[2];
  d.opacity_map = maps[3];
  d.normal_map = maps[4];
  d.emissive_map = maps[5];
  s.surfaces.push_back(d);
}

void add_light(SceneData& s, nb::handle light) {
  LightData d = {};
  d.each(Fields(light));
  require(d.kind >= 0 && d.kind < LIGHT_KINDS, "unknown kind of light");
  require(d.texture < static_cast<int>(s.textures.size()), "light's texture does not exist");
  require(!d.is_image() || (d.texture >= 0 && s.textures[d.texture].faces == 6),
          "an image light has a texture with six faces");
  s.lights.push_back(d);
}

void set_fog(SceneData& s, float start, float end, Rgb color) {
  s.medium.fog = true;
  s.medium.fog_start = start;
  s.medium.fog_end = end;
  std::copy(color.begin(), color.end(), s.medium.fog_color);
}

void set_haze(SceneData& s, float ratio, float radius, Rgb color) {
  s.medium.haze = true;
  s.medium.haze_ratio = ratio;
  s.medium.haze_radius = radius;
  std::copy(color.begin(), color.end(), s.medium.haze_color);
}

BoundCaster* make_caster(const SceneData& scene, const Optics& optics, const Tracing& tracing,
                         int threads, const std::string& isa, const BoundCaster* before) {
  require(scene.skybox < static_cast<int>(scene.textures.size()),
          "the skybox's texture does not exist");
  require(scene.skybox < 0 || scene.textures[scene.skybox].faces == 6, "a skybox has six faces");
  return new BoundCaster{{scene, optics, tracing, threads, isa, before ? &before->caster : nullptr},
                         scene.geom_type.size(),
                         scene.lights.size(),
                         static_cast<size_t>(optics.width),
                         static_cast<size_t>(optics.height),
                         tracing.rgb};
}

void deform_mesh(BoundCaster& b, int mesh, In<float, N, 3> vertices, In<float, N, 3> normals) {
  require(mesh >= 0 && mesh < b.caster.mesh_count(), "the mesh does not exist");
  size_t count = static_cast<size_t>(b.caster.mesh(mesh).vertex_count);
  require(vertices.shape(0) == count && normals.shape(0) == count,
          "as many vertices as the mesh was made with");
  b.caster.deform_mesh(mesh, vertices.data(), normals.data());
}

void resize_geoms(BoundCaster& b, In<int32_t, N> geoms, In<float, N, 3> sizes) {
  require(geoms.shape(0) == sizes.shape(0), "one size for each geom");
  for (size_t i = 0; i < geoms.shape(0); i++) {
    int geom = geoms.data()[i];
    require(geom >= 0 && geom < static_cast<int>(b.geoms), "the geom does not exist");
    int shape = b.caster.shape(geom);
    require(shape != PLANE && shape != HFIELD && shape != MESH, "only shapes have a new size");
  }
  b.caster.resize_geoms(geoms.data(), sizes.data(), static_cast<int>(geoms.shape(0)));
}

void set_light_gains(BoundCaster& b, In<float, N> gains) {
  require(gains.shape(0) == b.lights, "gains for another number of lights");
  b.caster.set_light_gains(gains.data());
}

void render(BoundCaster& b, In<double, N, 3> geom_pos, In<double, N, 9> geom_mat,
            In<double, N, 3> light_pos, In<double, N, 3> light_dir, In<double, 3> camera_pos,
            In<double, 9> camera_mat, Out<float, N, N> luminance,
            std::optional<Out<float, N, N, 3>> rgb, int seed,
            std::optional<Out<float, N, N>> copy) {
  require(luminance.shape(0) == b.height && luminance.shape(1) == b.width,
          "luminance is (height, width)");
  require(!rgb || b.rgb, "colour is given only by a caster that was made with rgb");
  require(!rgb || (rgb->shape(0) == b.height && rgb->shape(1) == b.width),
          "rgb is (height, width, 3)");
  require(!copy || (copy->shape(0) == b.height && copy->shape(1) == b.width),
          "copy is (height, width)");
  Poses poses = checked_poses(b, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat);
  poses.seed = seed;
  GilRelease release;
  b.caster.render(poses, luminance.data(), rgb ? rgb->data() : nullptr);
  // copy here, without the GIL
  if (copy) std::copy_n(luminance.data(), b.height * b.width, copy->data());
}

void trace_truth(BoundCaster& b, In<double, N, 3> geom_pos, In<double, N, 9> geom_mat,
                 In<double, N, 3> light_pos, In<double, N, 3> light_dir, In<double, 3> camera_pos,
                 In<double, 9> camera_mat, Out<int32_t, N, N> geom, Out<float, N, N> distance,
                 Out<float, N, N, 3> point, Out<float, N, N, 3> normal, Out<int32_t, N, N> triangle,
                 Out<float, N, N, 2> barycentric) {
  auto fits = [&](const auto& array) {
    return array.shape(0) == b.height && array.shape(1) == b.width;
  };
  require(fits(geom) && fits(distance) && fits(point) && fits(normal) && fits(triangle) &&
              fits(barycentric),
          "every output is (height, width, ...)");
  Poses poses = checked_poses(b, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat);
  Truth out = {geom.data(),   distance.data(), point.data(),
               normal.data(), triangle.data(), barycentric.data()};
  GilRelease release;
  b.caster.trace_truth(poses, out);
}

void trace_pixels(BoundCaster& b, In<double, N, 3> geom_pos, In<double, N, 9> geom_mat,
                  In<double, N, 3> light_pos, In<double, N, 3> light_dir, In<double, 3> camera_pos,
                  In<double, 9> camera_mat, In<int32_t, N> x, In<int32_t, N> y,
                  Out<float, N> luminance, int seed) {
  require(!b.caster.hybrid(), "single pixels of hybrid are those of render");
  Poses poses = checked_poses(b, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat);
  size_t count = x.shape(0);
  require(y.shape(0) == count && luminance.shape(0) == count,
          "x, y and luminance differ in length");
  require(count < (1u << 30), "fewer than 2^30 pixels in one call");
  for (size_t i = 0; i < count; i++) {
    int column = x.data()[i], row = y.data()[i];
    require(column >= 0 && row >= 0 && column < static_cast<int>(b.width) &&
                row < static_cast<int>(b.height),
            "a pixel lies outside the image");
  }
  poses.seed = seed;
  GilRelease release;
  b.caster.trace_pixels(poses, x.data(), y.data(), static_cast<int>(count), luminance.data());
}

void cycle_light(In<float, N, N, N> planes, In<float, N, N> before, int newest,
                 Out<float, N, N> light) {
  size_t sets = planes.shape(0), height = planes.shape(1), width = planes.shape(2);
  require(sets >= 2 && sets <= 64, "a cycle has 2 ... 64 sets");
  require(newest >= 0 && newest < static_cast<int>(sets), "the newest set is one of them");
  require(before.shape(0) == height && before.shape(1) == width && light.shape(0) == height &&
              light.shape(1) == width,
          "arrays differ in size");
  GilRelease release;
  combine_cycle(planes.data(), before.data(), static_cast<int>(sets), newest, height * width,
                light.data());
}

// The irradiance cache. Returns its tick, and by how many levels it is coarser.
std::tuple<long, int> save_irradiance(const BoundCaster& b,
                                      Out<int32_t, N, IrradianceCache::STATE_INTS> numbers,
                                      Out<float, N, IrradianceCache::STATE_FLOATS> light) {
  require(b.caster.hybrid(), "only hybrid has an irradiance cache");
  const IrradianceCache& cache = b.caster.hybrid()->irradiance();
  size_t nodes = static_cast<size_t>(cache.size());
  require(numbers.shape(0) == nodes && light.shape(0) == nodes, "as many rows as nodes");
  cache.save(numbers.data(), light.data());
  return {cache.tick(), cache.coarser()};
}

bool restore_irradiance(BoundCaster& b, long tick, int coarser,
                        In<int32_t, N, IrradianceCache::STATE_INTS> numbers,
                        In<float, N, IrradianceCache::STATE_FLOATS> light) {
  require(b.caster.hybrid(), "only hybrid has an irradiance cache");
  require(numbers.shape(0) == light.shape(0) && light.shape(0) < (1u << 28),
          "numbers and light of as many nodes");
  return b.caster.hybrid()->restore_irradiance(tick, coarser, static_cast<int>(light.shape(0)),
                                               numbers.data(), light.data());
}

std::map<std::string, long> work_of(const BoundCaster& b) {
  const WorkCounters& w = b.caster.work();
  std::map<std::string, long> work = {{"ticks", w.ticks},
                                      {"packets_asked", w.packets_tested},
                                      {"packets_traced", w.packets_traced},
                                      {"packets_relit", w.packets_relit},
                                      {"trees_built", b.caster.scene().bvhs_built},
                                      {"trees_refitted", b.caster.scene().bvhs_refitted}};
  if (b.caster.hybrid()) {
    const IrradianceCache& cache = b.caster.hybrid()->irradiance();
    work["cache_nodes"] = cache.size();
    work["cache_paths"] = cache.paths();
    work["cache_bytes"] = static_cast<long>(cache.bytes());
  }
  return work;
}

}  // namespace

void bind_caster(nb::module_& m) {
  nb::class_<Optics>(m, "Optics", "A camera's pixels and rays.")
      .def(nb::new_(&make_optics), nb::kw_only(), nb::arg("width"), nb::arg("height"),
           nb::arg("fx"), nb::arg("fy"), nb::arg("cx"), nb::arg("cy"),
           nb::arg("orthographic") = false, nb::arg("lens").none() = nb::none(),
           nb::arg("share").none() = nb::none(), nb::arg("near") = 0.0,
           nb::arg("near_sphere") = false,
           "Args:\n"
           "    width, height: The image's size, px.\n"
           "    fx, fy: The focal lengths, px; px/m if orthographic.\n"
           "    cx, cy: The principal point, px.\n"
           "    orthographic: Whether the rays are parallel.\n"
           "    lens: (height + 1, width + 1, 3) float32, the ray at each pixel corner,\n"
           "        camera frame; None for a pinhole.\n"
           "    share: (height, width) float32, the vignetting: the share of the light that\n"
           "        reaches a pixel; None for all of it.\n"
           "    near: The depth of the near plane, m; nothing nearer is seen.\n"
           "    near_sphere: Whether it is a sphere with that radius instead.");

  nb::class_<Tracing>(m, "Tracing", "How light is computed, and what is output.")
      .def(nb::new_(&make_tracing), nb::kw_only(), nb::arg("samples") = 1,
           nb::arg("adaptive") = false, nb::arg("shadows") = true, nb::arg("incremental") = false,
           nb::arg("rgb") = false, nb::arg("integrator") = "direct", nb::arg("bounces") = 0,
           nb::arg("sample_set") = "owen", nb::arg("block") = 0, nb::arg("blocks") = 1,
           nb::arg("nodes") = 0, nb::arg("forced") = FeatureFlags{},
           "Args:\n"
           "    samples: The number of samples per pixel.\n"
           "    adaptive: Take all samples only at edges; elsewhere one, or a quarter (path).\n"
           "    shadows: Whether lights cast shadows.\n"
           "    incremental: With a still camera, reuse what nothing that moved can affect.\n"
           "    rgb: Whether `render` can output colour.\n"
           "    integrator: direct, hybrid or path.\n"
           "    bounces: The largest number of bounces of a path.\n"
           "    sample_set: The sampler of path: sobol, owen, global, random or anchored.\n"
           "    block, blocks: Which block of a point set the samples of path are, of how many.\n"
           "    nodes: The most nodes of hybrid's cache; 0 for as many as the image needs.\n"
           "    forced: Features by name that are forced on (the output keeps its bytes) or\n"
           "        off, for tests.");

  m.def("combine_cycle", &cycle_light, nb::arg("planes"), nb::arg("before"), nb::arg("newest"),
        nb::arg("light"),
        "Combine the light of the sets of a cycle.\n"
        "\n"
        "Args:\n"
        "    planes: (m, h, w) float32, the light of each set when it was traced last.\n"
        "    before: (h, w) float32, the light of the newest set one cycle ago.\n"
        "    newest: The set of this tick.\n"
        "    light: (h, w) float32, out: the mean; the middle of the cycle where light changes.");

  m.def("isa_available", &isa_available,
        "Return the instruction sets that this build and this machine support, fastest\n"
        "first.");

  nb::class_<SceneData>(m, "SceneData",
                        "The constant part of a scene.\n"
                        "\n"
                        "Fill it once, in this order: textures, surfaces, meshes, lights, geoms.")
      .def(nb::init<>())
      .def("add_texture", &add_texture, nb::arg("data"), nb::arg("srgb"), nb::arg("like") = -1,
           "Add a texture.\n"
           "\n"
           "Args:\n"
           "    data: (faces, height, width, components) uint8, with 1 or 6 faces.\n"
           "    srgb: Whether the image is display-coded.\n"
           "    like: The index of the same image in the scene of the caster's `before`; -1\n"
           "        for none.\n"
           "\n"
           "Returns:\n"
           "    The texture's index.")
      .def("add_surface", &add_surface, nb::arg("rgba"), nb::arg("texture"), nb::arg("repeat"),
           nb::arg("uniform"), nb::arg("emission"), nb::arg("specular"), nb::arg("shininess"),
           nb::arg("reflectance"), nb::arg("metallic"), nb::arg("roughness"), nb::arg("maps"),
           "Add a surface, MuJoCo's material.\n"
           "\n"
           "Args:\n"
           "    rgba: The display-coded colour.\n"
           "    texture: The index of the colour texture; -1 for none.\n"
           "    maps: The textures for metallic, roughness, occlusion, opacity, normal and\n"
           "        emissive; -1 for none.")
      .def("add_mesh", &add_mesh, nb::arg("vertices"), nb::arg("faces"), nb::arg("normals").none(),
           nb::arg("texcoords").none(),
           "Add a mesh.\n"
           "\n"
           "Args:\n"
           "    vertices: (nv, 3) float32, m.\n"
           "    faces: (nf, 3) int32.\n"
           "    normals: (nf, 3, 3) float32, one for each corner of each face; None for\n"
           "        flat faces.\n"
           "    texcoords: (nf, 3, 2) float32; None if the mesh has none.")
      .def("share_mesh", &share_mesh, nb::arg("caster"), nb::arg("mesh"),
           "Add the mesh of a caster. The scenes share it until one of them deforms it.")
      .def("add_light", &add_light, nb::arg("light"),
           "Add a Light of emulator/base/scene.py. Its intensity is in units of light.")
      .def("set_fog", &set_fog, nb::arg("start"), nb::arg("end"), nb::arg("color"),
           "Add fog. The distances are in m, and the colour is display-coded.")
      .def("set_haze", &set_haze, nb::arg("ratio"), nb::arg("radius"), nb::arg("color"),
           "Add haze.\n"
           "\n"
           "Args:\n"
           "    ratio: The share of the distance to the horizon that the haze covers.\n"
           "    radius: The distance to the horizon, m.\n"
           "    color: The display-coded colour.")
      .def("set_geoms", &set_geoms, nb::arg("type"), nb::arg("size"), nb::arg("mesh"),
           nb::arg("surface"),
           "Set the geoms: type, mesh and surface (ng,) int32; size (ng, 3) float32, m.")
      .def_rw("skybox", &SceneData::skybox, "The index of the skybox's texture; -1 for none.")
      .def_rw("sky_shines", &SceneData::sky_shines,
              "Whether the skybox lights the scene and is in mirrors; else it is a backdrop.");

  nb::class_<BoundCaster>(m, "Caster", "A ray caster: one camera's view of one scene.")
      .def(nb::new_(&make_caster), nb::arg("scene"), nb::arg("optics"), nb::arg("tracing"),
           nb::kw_only(), nb::arg("threads") = 1, nb::arg("isa") = "auto",
           nb::arg("before").none() = nb::none(),
           "Args:\n"
           "    threads: The number of threads; 0 for one per core.\n"
           "    isa: An instruction set of isa_available(), or auto.\n"
           "    before: The previous caster of the same camera, whose threads and images\n"
           "        are reused.")
      .def("trace_pixels", &trace_pixels, nb::arg("geom_pos"), nb::arg("geom_mat"),
           nb::arg("light_pos"), nb::arg("light_dir"), nb::arg("camera_pos"), nb::arg("camera_mat"),
           nb::arg("x"), nb::arg("y"), nb::arg("luminance"), nb::arg("seed") = 0,
           "Render single pixels.\n"
           "\n"
           "Args:\n"
           "    geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.\n"
           "    light_pos, light_dir: (nl, 3) float64, world frame.\n"
           "    camera_pos, camera_mat: (3,) and (9,) float64, world frame.\n"
           "    x, y: (n,) int32, pixels in the image.\n"
           "    luminance: (n,) float32, the output.\n"
           "    seed: The seed of this tick, for the path integrator.")
      .def("set_light_gains", &set_light_gains, nb::arg("gains"),
           "Scale each light's strength from the next call on.\n"
           "\n"
           "Args:\n"
           "    gains: (nl,) float32; 1 is the scene's strength.")
      .def("deform", &deform_mesh, nb::arg("mesh"), nb::arg("vertices"), nb::arg("normals"),
           "Set new vertices (nv, 3) and unit normals (nv, 3) of a mesh, before a call of\n"
           "render.")
      .def("resize", &resize_geoms, nb::arg("geoms"), nb::arg("sizes"),
           "Set new sizes of geoms, before a call of render.\n"
           "\n"
           "Args:\n"
           "    geoms: (n,) int32, neither planes nor meshes.\n"
           "    sizes: (n, 3) float32, m. A geom with radius 0 is invisible.")
      .def("render", &render, nb::arg("geom_pos"), nb::arg("geom_mat"), nb::arg("light_pos"),
           nb::arg("light_dir"), nb::arg("camera_pos"), nb::arg("camera_mat"), nb::arg("luminance"),
           nb::arg("rgb").none() = nb::none(), nb::arg("seed") = 0,
           nb::arg("copy").none() = nb::none(),
           "Render the image.\n"
           "\n"
           "The luminance and rgb arrays must be the same in every call and must not be\n"
           "modified between calls.\n"
           "\n"
           "Args:\n"
           "    geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.\n"
           "    light_pos, light_dir: (nl, 3) float64, world frame.\n"
           "    camera_pos, camera_mat: (3,) and (9,) float64, world frame.\n"
           "    luminance: (h, w) float32, the output.\n"
           "    rgb: (h, w, 3) float32, the output in colour; None for no colour.\n"
           "    seed: The seed of this tick, for the path integrator.\n"
           "    copy: (h, w) float32, a copy of the luminance; None for no copy.")
      .def("trace_truth", &trace_truth, nb::arg("geom_pos"), nb::arg("geom_mat"),
           nb::arg("light_pos"), nb::arg("light_dir"), nb::arg("camera_pos"), nb::arg("camera_mat"),
           nb::arg("geom"), nb::arg("distance"), nb::arg("point"), nb::arg("normal"),
           nb::arg("triangle"), nb::arg("barycentric"),
           "Compute the ground truth: the first hit of the ray through each pixel's centre.\n"
           "\n"
           "Args:\n"
           "    geom_pos, geom_mat: (ng, 3) and (ng, 9) float64, world frame.\n"
           "    light_pos, light_dir: (nl, 3) float64, world frame.\n"
           "    camera_pos, camera_mat: (3,) and (9,) float64, world frame.\n"
           "    geom: (h, w) int32, the output: the geom; -1 for none.\n"
           "    distance: (h, w) float32, the output, m.\n"
           "    point: (h, w, 3) float32, the output, camera frame; the ray's direction\n"
           "        where nothing is hit.\n"
           "    normal: (h, w, 3) float32, the output, camera frame.\n"
           "    triangle: (h, w) int32, the output: the face of a mesh; -1 for none.\n"
           "    barycentric: (h, w, 2) float32, the output: the weights of the face's\n"
           "        second and third corner.")
      .def_prop_ro(
          "traced_fraction", [](const BoundCaster& b) { return b.caster.traced_fraction(); },
          "The share of the last tick that was traced, 0 ... 1.")
      .def_prop_ro(
          "channels", [](const BoundCaster& b) { return b.caster.channels(); },
          "The number of channels: luminance, RGB, or both.")
      .def_prop_ro(
          "features", [](const BoundCaster& b) { return b.caster.features(); },
          "The active features by name, as of the last tick where that decides.")
      .def(
          "restart",
          [](BoundCaster& b) {
            if (b.caster.hybrid()) b.caster.hybrid()->restart();
          },
          "Forget what earlier ticks left in the light of hybrid.")
      .def("save_irradiance", &save_irradiance, nb::arg("numbers"), nb::arg("light"),
           "Copy the irradiance cache of hybrid, of n = work[\"cache_nodes\"] nodes.\n"
           "\n"
           "Args:\n"
           "    numbers: (n, 7) int32, the output: each node's key and flags.\n"
           "    light: (n, 27) float32, the output: each node's place and light.\n"
           "\n"
           "Returns:\n"
           "    Ticks since the start; by how many levels the lattice is coarser than asked.")
      .def("restore_irradiance", &restore_irradiance, nb::arg("tick"), nb::arg("coarser"),
           nb::arg("numbers"), nb::arg("light"),
           "Take back what save_irradiance gave.\n"
           "\n"
           "Returns:\n"
           "    Whether it is valid; if not, nothing changes.")
      .def_prop_ro("work", &work_of,
                   "The work done so far: ticks; packets of 4 x 4 pixels that were tested against\n"
                   "moving geoms, traced and relit; BVHs that were built and refitted; with\n"
                   "hybrid the nodes and bytes of its cache, and the paths traced for them.");
}

}  // namespace evs
