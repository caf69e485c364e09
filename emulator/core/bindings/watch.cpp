// Watch arrays that other code writes: whether they have changed, and a digest of their contents.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/vector.h>

#include <cstring>
#include <vector>

namespace nb = nanobind;

namespace evs {
namespace {

using Array = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;

// Arrays of other owners, and a copy of their contents.
class Watch {
 public:
  explicit Watch(std::vector<Array> arrays) : arrays_(std::move(arrays)) {
    size_t bytes = 0;
    for (const Array& a : arrays_) bytes += a.nbytes();
    known_.resize(bytes);
    keep();
  }

  // Does any byte differ from the copy? Equal NaNs count as equal.
  bool changed() const {
    const uint8_t* known = known_.data();
    for (const Array& a : arrays_) {
      size_t bytes = a.nbytes();
      if (bytes && std::memcmp(a.data(), known, bytes) != 0) return true;
      known += bytes;
    }
    return false;
  }

  void keep() {
    uint8_t* known = known_.data();
    for (const Array& a : arrays_) {
      size_t bytes = a.nbytes();
      if (bytes) std::memcpy(known, a.data(), bytes);
      known += bytes;
    }
  }

 private:
  std::vector<Array> arrays_;
  std::vector<uint8_t> known_;
};

constexpr uint64_t ODD = 0x9e3779b97f4a7c15u;  // 2^64 over the golden ratio

// One step of a lane: a bijection of the word for a given state, and of the state for a given word,
// so a single changed word always changes the result.
uint64_t mixed(uint64_t state, uint64_t word) {
  uint64_t h = (state ^ word) * ODD;
  return h ^ (h >> 29);
}

// In four lanes, so that multiplications do not wait for each other.
uint64_t digest(const std::vector<Array>& arrays) {
  uint64_t lane[4] = {1, 2, 3, 4};
  for (const Array& a : arrays) {
    const auto* bytes = static_cast<const uint8_t*>(a.data());
    size_t count = a.nbytes(), at = 0;
    uint64_t words[4];
    for (; at + sizeof words <= count; at += sizeof words) {
      std::memcpy(words, bytes + at, sizeof words);
      for (int k = 0; k < 4; k++) lane[k] = mixed(lane[k], words[k]);
    }
    std::memset(words, 0, sizeof words);
    if (at < count) std::memcpy(words, bytes + at, count - at);
    for (int k = 0; k < 4; k++) lane[k] = mixed(lane[k], words[k]);
    lane[0] = mixed(lane[0], count);
  }
  uint64_t all = 0;
  for (uint64_t one : lane) all = mixed(all, one);
  return all;
}

}  // namespace

void bind_watch(nb::module_& m) {
  nb::class_<Watch>(m, "Watch",
                    "A watch on arrays of other owners: it compares them with a copy of their\n"
                    "contents.")
      .def(nb::init<std::vector<Array>>(), nb::arg("arrays"),
           "Args:\n"
           "    arrays: Contiguous, of any shape and type. Their contents are copied now.")
      .def("changed", &Watch::changed, "Return whether any byte differs from the copy.")
      .def("keep", &Watch::keep, "Copy the contents again.");
  m.def("digest", &digest, nb::arg("arrays"),
        "Return a 64-bit digest of the arrays in their order. A single changed word\n"
        "always changes it.");
}

}  // namespace evs
