// The table of the tracer's entry points for one instruction set.
//
// base/simd_target.h explains the technique. Besides its macros, each kernel_*.cpp defines:
//
//   EVS_KERNEL   the name of the table
//   EVS_PAIR     the name of an entry point that takes two packets at once, or nullptr
//   EVS_PATHS    the name of an entry point of `path`, if *_pairs_*.cpp has them
#pragma once

#ifndef EVS_KERNEL
#define EVS_KERNEL KERNEL_PORTABLE
#define EVS_PAIR(name) nullptr
#endif

#include "render/incremental/dirty_packets.inl"
#include "render/incremental/relight.inl"
#include "render/integrators/antialiasing.inl"
#include "render/integrators/direct.inl"
#include "render/integrators/ground_truth.inl"
#include "render/integrators/hybrid.inl"
#include "render/simd/sampler_probe.inl"
#include "scene/path_scene.h"
#include "scene/scene.h"
#ifndef EVS_PATHS
#include "render/incremental/dirty_set.inl"
#include "render/irradiance/node_light.inl"
#define EVS_PATHS(name) EVS_NAMESPACE::name
#endif

namespace evs {

const Kernel EVS_KERNEL = {EVS_NAMESPACE::trace,
                           EVS_PAIR(trace),
                           EVS_NAMESPACE::relight,
                           EVS_PAIR(relight),
                           EVS_NAMESPACE::trace_pixels,
                           EVS_NAMESPACE::refinement_weight,
                           EVS_NAMESPACE::refine,
                           EVS_NAMESPACE::trace_truth,
                           EVS_NAMESPACE::find_dirty_packets,
                           EVS_PATHS(trace_path_row),
                           EVS_PATHS(trace_path_pixels),
                           EVS_PATHS(trace_marked_row),
                           EVS_PATHS(first_geoms),
                           EVS_PATHS(update_cached_paths),
                           EVS_NAMESPACE::trace_hybrid,
                           EVS_NAMESPACE::relight_hybrid,
                           EVS_PAIR(trace_hybrid),
                           EVS_NAMESPACE::refine_hybrid,
                           EVS_PATHS(lamp_points),
                           EVS_PATHS(place_mesh_nodes),
                           EVS_PATHS(move_hidden_nodes),
                           EVS_PATHS(light_nodes),
                           EVS_NAMESPACE::probe_sampler,
                           EVS_NAMESPACE::probe_bsdf_sample,
                           EVS_NAMESPACE::probe_bsdf,
                           EVS_NAMESPACE::probe_light_sample,
                           EVS_NAMESPACE::probe_light_pdf};

}  // namespace evs
