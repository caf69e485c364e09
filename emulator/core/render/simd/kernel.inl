// The tracer's entry points for one instruction set; base/simd_target.h says how this is put
// together.
#pragma once

#include "incremental/dirty_packets.inl"
#include "incremental/relight.inl"
#include "integrators/direct_pixels.inl"
#include "integrators/ground_truth.inl"
#include "integrators/refine.inl"
#include "path_scene.h"
#include "scene.h"
#include "simd/probe.inl"
#include "simd/target.inl"
#ifndef EVS_PATHS
#include "incremental/dirty_set.inl"
#define EVS_PATHS(name) EVS_SPACE::name
#endif

namespace evs {

const Kernel EVS_KERNEL = {EVS_SPACE::trace,
                           EVS_PAIR(trace),
                           EVS_SPACE::relight,
                           EVS_PAIR(relight),
                           EVS_SPACE::trace_pixels,
                           EVS_SPACE::refinement_weight,
                           EVS_SPACE::refine,
                           EVS_SPACE::trace_truth,
                           EVS_SPACE::find_dirty_packets,
                           EVS_PATHS(trace_path_row),
                           EVS_PATHS(trace_path_pixels),
                           EVS_PATHS(update_cached_paths),
                           EVS_SPACE::probe_sampler,
                           EVS_SPACE::probe_bsdf_sample,
                           EVS_SPACE::probe_bsdf,
                           EVS_SPACE::probe_light_sample,
                           EVS_SPACE::probe_light_pdf};

}  // namespace evs
