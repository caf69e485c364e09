// The CPU's side of the comparison with a GPU, as a library for measure.py: what single operations
// give here.

#include <cstdint>
#include <cstring>
#include <thread>
#include <vector>

#include "base/thread_pool.h"
#include "tests/emulator/core/gpu/math_ops.inl"

#define EVS_EXPORT extern "C" __attribute__((visibility("default")))

namespace evs {
namespace {

// Call part(k) for k = 0 ... threads - 1, in as many threads, with denormals flushed.
template <class Part>
void in_threads(int threads, const Part& part) {
  std::vector<std::thread> workers;
  for (int k = 0; k < threads; k++) {
    workers.emplace_back([&part, k] {
      FlushDenormals flush;
      part(k);
    });
  }
  for (std::thread& worker : workers) worker.join();
}

}  // namespace

// What differs between numbers of a CPU and of a GPU.
struct Difference {
  uint64_t values;     // with other bits, but for
  uint64_t nan_only;   // those that are NaN in both
  uint64_t zero_only;  // of `values`: zeros of another sign
  uint64_t at;         // the first of `values`: its number, operands and results
  uint32_t a, b, cpu, gpu;
};

// Compare results of operation `op` for `count` operands from `first` on. In/out: `found`, zero
// before the first call.
EVS_EXPORT void math_compare(int op, uint64_t first, uint64_t count, const int32_t* gpu,
                             int threads, Difference* found) {
  std::vector<Difference> parts(static_cast<size_t>(threads), Difference{});
  in_threads(threads, [&](int k) {
    Difference& part = parts[static_cast<size_t>(k)];
    uint64_t begin = count / 16 * static_cast<uint64_t>(k) / static_cast<uint64_t>(threads) * 16;
    uint64_t end = count / 16 * static_cast<uint64_t>(k + 1) / static_cast<uint64_t>(threads) * 16;
    for (uint64_t at = begin; at < end; at += 16) {
      alignas(64) int a[16], b[16], cpu[16];
      for (int i = 0; i < 16; i++) {
        Operands in =
            operands(op >= portable::FIRST_BINARY_OP, first + at + static_cast<uint64_t>(i));
        a[i] = static_cast<int>(in.a), b[i] = static_cast<int>(in.b);
      }
      portable::store(cpu, portable::math_op(op, portable::load(a), portable::load(b)));
      if (std::memcmp(cpu, gpu + at, sizeof cpu) == 0) continue;
      for (int i = 0; i < 16; i++) {
        uint32_t here = static_cast<uint32_t>(cpu[i]),
                 there = static_cast<uint32_t>(gpu[at + static_cast<uint64_t>(i)]);
        if (here == there) continue;
        auto is_nan = [](uint32_t bits) { return (bits & 0x7fffffffu) > 0x7f800000u; };
        if (portable::gives_float(op) && is_nan(here) && is_nan(there)) {
          part.nan_only++;
          continue;
        }
        if (portable::gives_float(op) && ((here | there) & 0x7fffffffu) == 0) part.zero_only++;
        if (part.values++ == 0) {
          part.at = first + at + static_cast<uint64_t>(i);
          part.a = static_cast<uint32_t>(a[i]), part.b = static_cast<uint32_t>(b[i]);
          part.cpu = here, part.gpu = there;
        }
      }
    }
  });
  for (const Difference& part : parts) {
    found->nan_only += part.nan_only;
    found->zero_only += part.zero_only;
    if (found->values == 0 && part.values > 0) {
      uint64_t nan = found->nan_only, zero = found->zero_only;
      *found = part;
      found->nan_only = nan, found->zero_only = zero;
    } else {
      found->values += part.values;
    }
  }
}

}  // namespace evs
