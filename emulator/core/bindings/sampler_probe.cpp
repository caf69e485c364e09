// The path integrator's samplers for tests: random numbers in, samples and pdfs out.

#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <array>
#include <string>

#include "bindings/bound_caster.h"
#include "render/simd/sampler_probe_lanes.h"

namespace evs {
namespace {

using V = std::array<float, 3>;

// Call f on 16 entries at a time; unused lanes repeat the last entry.
template <class F>
void by_lanes(size_t count, F&& f) {
  for (size_t first = 0; first < count; first += PROBE_LANES) {
    size_t at[PROBE_LANES];
    for (size_t i = 0; i < PROBE_LANES; i++) at[i] = std::min(first + i, count - 1);
    f(at, std::min<size_t>(PROBE_LANES, count - first));
  }
}

void sampler_points(const std::string& sampler, int index, int dimension, In<int32_t, N> pixels,
                    Out<float, N, 2> out, int seed, int log2_samples, int block, int log2_blocks) {
  require(out.shape(0) == pixels.shape(0), "one point for each pixel");
  require(log2_samples >= 0 && log2_blocks >= 0 && log2_samples + log2_blocks <= 30,
          "0 to 30 digits");
  int mode = sample_set_of(sampler);
  by_lanes(pixels.shape(0), [&](const size_t* at, size_t count) {
    int pixel[PROBE_LANES];
    float x[PROBE_LANES], y[PROBE_LANES];
    for (int i = 0; i < PROBE_LANES; i++) pixel[i] = pixels.data()[at[i]];
    kernel_of("auto")->probe_sampler(mode, seed, log2_samples, block, log2_blocks, index, dimension,
                                     pixel, x, y);
    for (size_t i = 0; i < count; i++) {
      out.data()[2 * at[i]] = x[i];
      out.data()[2 * at[i] + 1] = y[i];
    }
  });
}

ProbeSurface surface_of(float albedo, float f0, float metallic, float alpha, float mirror, V eye) {
  return {{albedo, albedo, albedo}, {f0, f0, f0}, metallic, alpha, mirror,
          {eye[0], eye[1], eye[2]}};
}

void sample_bsdf(float albedo, float f0, float metallic, float alpha, float mirror, V eye,
                 In<float, N, 4> numbers, Out<float, N, 3> direction, Out<float, N, 3> light,
                 Out<float, N> pdf, Out<float, N> pdf_evaluated, Out<int32_t, N> mirrored,
                 Out<int32_t, N> alive) {
  size_t n = numbers.shape(0);
  require(direction.shape(0) == n && light.shape(0) == n && pdf.shape(0) == n &&
              pdf_evaluated.shape(0) == n && mirrored.shape(0) == n && alive.shape(0) == n,
          "arrays differ in length");
  ProbeSurface surface = surface_of(albedo, f0, metallic, alpha, mirror, eye);
  by_lanes(n, [&](const size_t* at, size_t count) {
    float u[4 * PROBE_LANES];
    for (int k = 0; k < 4; k++) {
      for (int i = 0; i < PROBE_LANES; i++) u[k * PROBE_LANES + i] = numbers.data()[4 * at[i] + k];
    }
    ProbeLanes out;
    kernel_of("auto")->probe_bsdf_sample(surface, u, out);
    for (size_t i = 0; i < count; i++) {
      for (int c = 0; c < 3; c++) {
        direction.data()[3 * at[i] + c] = out.direction[c][i];
        light.data()[3 * at[i] + c] = out.value[c][i];
      }
      pdf.data()[at[i]] = out.pdf[i];
      pdf_evaluated.data()[at[i]] = out.pdf_evaluated[i];
      mirrored.data()[at[i]] = out.specular[i];
      alive.data()[at[i]] = out.alive[i];
    }
  });
}

void evaluate_bsdf(float albedo, float f0, float metallic, float alpha, float mirror, V eye,
                   In<float, N, 3> direction, Out<float, N, 3> light, Out<float, N> pdf) {
  size_t n = direction.shape(0);
  require(light.shape(0) == n && pdf.shape(0) == n, "arrays differ in length");
  ProbeSurface surface = surface_of(albedo, f0, metallic, alpha, mirror, eye);
  by_lanes(n, [&](const size_t* at, size_t count) {
    ProbeLanes out;
    for (int c = 0; c < 3; c++) {
      for (int i = 0; i < PROBE_LANES; i++) out.direction[c][i] = direction.data()[3 * at[i] + c];
    }
    kernel_of("auto")->probe_bsdf(surface, out);
    for (size_t i = 0; i < count; i++) {
      for (int c = 0; c < 3; c++) light.data()[3 * at[i] + c] = out.value[c][i];
      pdf.data()[at[i]] = out.pdf[i];
    }
  });
}

Caster::KernelInputs kernel_inputs(BoundCaster& b, In<double, N, 3> geom_pos,
                                   In<double, N, 9> geom_mat, In<double, N, 3> light_pos,
                                   In<double, N, 3> light_dir, In<double, 3> camera_pos,
                                   In<double, 9> camera_mat) {
  return b.caster.kernel_inputs(
      checked_poses(b, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat));
}

void sample_light(BoundCaster& b, In<double, N, 3> geom_pos, In<double, N, 9> geom_mat,
                  In<double, N, 3> light_pos, In<double, N, 3> light_dir, In<double, 3> camera_pos,
                  In<double, 9> camera_mat, V point, bool environment, In<float, N, 3> numbers,
                  Out<float, N, 3> direction, Out<float, N, 3> light, Out<float, N> pdf,
                  Out<float, N> pdf_evaluated) {
  size_t n = numbers.shape(0);
  require(direction.shape(0) == n && light.shape(0) == n && pdf.shape(0) == n &&
              pdf_evaluated.shape(0) == n,
          "arrays differ in length");
  Caster::KernelInputs p =
      kernel_inputs(b, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat);
  require(!environment || p.paths.environment_probability > 0, "the environment is not sampled");
  by_lanes(n, [&](const size_t* at, size_t count) {
    float u[3 * PROBE_LANES];
    for (int k = 0; k < 3; k++) {
      for (int i = 0; i < PROBE_LANES; i++) u[k * PROBE_LANES + i] = numbers.data()[3 * at[i] + k];
    }
    ProbeLanes out;
    p.kernel.probe_light_sample(p.frame, p.paths, point.data(), environment, u, out);
    for (size_t i = 0; i < count; i++) {
      for (int c = 0; c < 3; c++) {
        direction.data()[3 * at[i] + c] = out.direction[c][i];
        light.data()[3 * at[i] + c] = out.value[c][i];
      }
      pdf.data()[at[i]] = out.pdf[i];
      pdf_evaluated.data()[at[i]] = out.pdf_evaluated[i];
    }
  });
}

void light_pdf(BoundCaster& b, In<double, N, 3> geom_pos, In<double, N, 9> geom_mat,
               In<double, N, 3> light_pos, In<double, N, 3> light_dir, In<double, 3> camera_pos,
               In<double, 9> camera_mat, V point, In<float, N, 3> direction, Out<float, N> pdf) {
  size_t n = direction.shape(0);
  require(pdf.shape(0) == n, "arrays differ in length");
  Caster::KernelInputs p =
      kernel_inputs(b, geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat);
  by_lanes(n, [&](const size_t* at, size_t count) {
    ProbeLanes out;
    for (int c = 0; c < 3; c++) {
      for (int i = 0; i < PROBE_LANES; i++) out.direction[c][i] = direction.data()[3 * at[i] + c];
    }
    p.kernel.probe_light_pdf(p.frame, p.paths, point.data(), out);
    for (size_t i = 0; i < count; i++) pdf.data()[at[i]] = out.pdf_evaluated[i];
  });
}

}  // namespace

void bind_sampler_probe(nb::module_& m) {
  m.def("probe_sampler", &sampler_points, nb::arg("sampler"), nb::arg("index"),
        nb::arg("dimension"), nb::arg("pixels"), nb::arg("out"), nb::arg("seed") = 0,
        nb::arg("log2_samples") = 6, nb::arg("block") = 0, nb::arg("log2_blocks") = 0,
        "Sample one dimension for pixels (n,): points (n, 2). For tests.");
  m.def("probe_bsdf_sample", &sample_bsdf, nb::arg("albedo"), nb::arg("f0"), nb::arg("metallic"),
        nb::arg("alpha"), nb::arg("mirror"), nb::arg("eye"), nb::arg("u"), nb::arg("direction"),
        nb::arg("light"), nb::arg("pdf"), nb::arg("pdf_evaluated"), nb::arg("specular"),
        nb::arg("alive"),
        "Sample the BSDF of a surface with its normal along z by random numbers (n, 4).\n"
        "For tests.");
  m.def("probe_bsdf", &evaluate_bsdf, nb::arg("albedo"), nb::arg("f0"), nb::arg("metallic"),
        nb::arg("alpha"), nb::arg("mirror"), nb::arg("eye"), nb::arg("direction"), nb::arg("light"),
        nb::arg("pdf"), "Evaluate f cos (n, 3) and the pdf (n,) of directions (n, 3). For tests.");
  m.def("probe_light_sample", &sample_light, nb::arg("caster"), nb::arg("geom_pos"),
        nb::arg("geom_mat"), nb::arg("light_pos"), nb::arg("light_dir"), nb::arg("camera_pos"),
        nb::arg("camera_mat"), nb::arg("point"), nb::arg("environment"), nb::arg("u"),
        nb::arg("direction"), nb::arg("light"), nb::arg("pdf"), nb::arg("pdf_evaluated"),
        "Sample light from a point by random numbers (n, 3), camera frame, and evaluate\n"
        "the pdf (n,) of the same directions. For tests.");
  m.def("probe_light_pdf", &light_pdf, nb::arg("caster"), nb::arg("geom_pos"), nb::arg("geom_mat"),
        nb::arg("light_pos"), nb::arg("light_dir"), nb::arg("camera_pos"), nb::arg("camera_mat"),
        nb::arg("point"), nb::arg("direction"), nb::arg("pdf"),
        "Evaluate the light-sampling pdf (n,) of what directions (n, 3) from a point\n"
        "hit. For tests.");
}

}  // namespace evs
