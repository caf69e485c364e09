// Python binding of what a caster is made of besides its scene: optics and tracing, both by
// keyword.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <optional>

#include "bound_caster.h"

namespace evs {
namespace {

Optics* make_optics(int width, int height, double fx, double fy, double cx, double cy,
                    bool orthographic, std::optional<In<float, N, N, 3>> lens,
                    std::optional<In<float, N, N>> share) {
  require(width > 0 && height > 0, "an image has pixels");
  require(fx > 0 && fy > 0 && std::isfinite(fx) && std::isfinite(fy) && std::isfinite(cx) &&
              std::isfinite(cy),
          "focal lengths are positive and finite");
  size_t w = static_cast<size_t>(width), h = static_cast<size_t>(height);
  Optics optics = {width, height, fx, fy, cx, cy, orthographic};
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
                      const FeatureFlags& forced) {
  require(samples >= 1 && samples <= 4096, "samples: 1 ... 4096");
  require(integrator == "direct" || integrator == "path", "the integrator is direct or path");
  bool path = integrator == "path";
  require(!path || !adaptive, "paths take all samples in every pixel");
  require(bounces >= 0 && bounces <= 1000, "bounces: 0 ... 1000");
  return new Tracing{samples,       adaptive, shadows, incremental,
                     rgb,           path,     bounces, sample_set_of(sample_set),
                     Forced(forced)};
}

}  // namespace

void bind_settings(nb::module_& m) {
  nb::class_<Optics>(m, "Optics", "Pixels and rays of one camera; lengths in px.")
      .def(
          nb::new_(&make_optics), nb::kw_only(), nb::arg("width"), nb::arg("height"), nb::arg("fx"),
          nb::arg("fy"), nb::arg("cx"), nb::arg("cy"), nb::arg("orthographic") = false,
          nb::arg("lens").none() = nb::none(), nb::arg("share").none() = nb::none(),
          "orthographic: fx and fy are px/m; lens (height + 1, width + 1, 3): the ray at each "
          "pixel "
          "corner, camera frame; share (height, width): the share of its light that a pixel gets.");

  nb::class_<Tracing>(m, "Tracing", "How light is computed, and what is output.")
      .def(
          nb::new_(&make_tracing), nb::kw_only(), nb::arg("samples") = 1,
          nb::arg("adaptive") = false, nb::arg("shadows") = true, nb::arg("incremental") = false,
          nb::arg("rgb") = false, nb::arg("integrator") = "direct", nb::arg("bounces") = 0,
          nb::arg("sample_set") = "owen", nb::arg("forced") = FeatureFlags{},
          "samples: of a pixel; adaptive: only where neighbours differ, one elsewhere; "
          "incremental: with a still camera, reuse what nothing that moved can affect; rgb: "
          "`render` can output colour; integrator: direct or path; bounces, sample_set: of path; "
          "forced: code paths by name that are on, with the same bytes, or off, whatever the scene "
          "needs, for tests.");
}

}  // namespace evs
