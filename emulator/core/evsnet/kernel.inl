// The kernels of EvSNet for one instruction set (base/simd_target.h). The includer also defines
// EVS_KERNEL, the name of their table.
#pragma once

#include "bilif.inl"
#include "inference.inl"
#include "log_delta.inl"
#include "network_kernel.h"

namespace evs {

const NetworkKernel EVS_KERNEL = {EVS_NAMESPACE::find_changes, EVS_NAMESPACE::log_delta,
                                  EVS_NAMESPACE::infer, EVS_NAMESPACE::integrate_and_fire};

}  // namespace evs
