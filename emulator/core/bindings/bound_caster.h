// Shared by the caster's bindings: arrays of checked shape, and a caster with its dimensions.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <string>

#include "bindings/values.h"
#include "render/caster.h"

namespace nb = nanobind;

namespace evs {

template <class T, nb::ssize_t... SHAPE>
using In = nb::ndarray<const T, nb::shape<SHAPE...>, nb::c_contig, nb::device::cpu>;
template <class T, nb::ssize_t... SHAPE>
using Out = nb::ndarray<T, nb::shape<SHAPE...>, nb::c_contig, nb::device::cpu>;
constexpr nb::ssize_t N = -1;

struct BoundCaster {
  Caster caster;
  size_t geoms, lights, width, height;
  bool rgb;
};

inline Poses checked_poses(const BoundCaster& b, In<double, N, 3> geom_pos,
                           In<double, N, 9> geom_mat, In<double, N, 3> light_pos,
                           In<double, N, 3> light_dir, In<double, 3> camera_pos,
                           In<double, 9> camera_mat) {
  require(geom_pos.shape(0) == b.geoms && geom_mat.shape(0) == b.geoms,
          "poses for another number of geoms");
  require(light_pos.shape(0) == b.lights && light_dir.shape(0) == b.lights,
          "poses for another number of lights");
  return {geom_pos.data(),  geom_mat.data(),   light_pos.data(),
          light_dir.data(), camera_pos.data(), camera_mat.data()};
}

inline SampleSet sample_set_of(const std::string& name) {
  const char* const sets[] = {"sobol", "owen", "global", "random", "anchored"};
  int set = 0;
  while (set < 5 && name != sets[set]) set++;
  require(set < 5, "the sample set is sobol, owen, global, random or anchored");
  return static_cast<SampleSet>(set);
}

}  // namespace evs
