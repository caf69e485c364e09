// Arrays and other values that the core and Python hand to each other.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>

namespace nb = nanobind;

namespace evs {

template <class T, size_t DIMENSIONS>
using Array = nb::ndarray<T, nb::ndim<DIMENSIONS>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<nb::numpy, uint8_t, nb::ndim<1>>;
using BytesIn = Array<const uint8_t, 1>;

inline void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(what);
}

// The number of an address.
template <class T>
T* at(uint64_t address) {
  return reinterpret_cast<T*>(address);
}

// A Python array that owns `data`.
template <class Out, class T>
Out owned(std::unique_ptr<T[]> data, size_t count) {
  nb::capsule owner(data.get(), [](void* p) noexcept { delete[] static_cast<T*>(p); });
  T* memory = data.release();
  return Out(memory, {count * sizeof(T) / sizeof(typename Out::Scalar)}, owner);
}

// Reads the fields of a struct from the attributes of those names. Throws where one is missing or
// of another type; no array is converted.
class Fields {
 public:
  explicit Fields(nb::handle values) : values_(values) {}

  template <class T>
  void operator()(const char* name, T& field, bool convert = true) const {
    if (!nb::try_cast(nb::object(values_.attr(name)), field, convert)) {
      throw nb::type_error((std::string(name) + " has another type").c_str());
    }
  }
  template <class T, size_t N>
  void operator()(const char* name, T (&field)[N]) const {
    std::array<T, N> values;
    operator()(name, values);
    std::copy(values.begin(), values.end(), field);
  }
  template <class... KIND>
  void operator()(const char* name, nb::ndarray<KIND...>& field) const {
    operator()(name, field, false);
  }

 private:
  nb::handle values_;
};

}  // namespace evs
