// The kernels of EvSNet for one instruction set (base/simd_target.h). The includer also defines
// EVS_KERNEL, the name of their table.
#pragma once

#include "evsnet/bilif.inl"
#include "evsnet/inference.inl"
#include "evsnet/log_delta.inl"
#include "evsnet/network_kernel.h"

namespace evs {

const NetworkKernel EVS_KERNEL = {EVS_NAMESPACE::find_changes, EVS_NAMESPACE::log_delta,
                                  EVS_NAMESPACE::infer, EVS_NAMESPACE::integrate_and_fire};

}  // namespace evs
