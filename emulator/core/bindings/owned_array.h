// Hand memory of the core to Python without a copy.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <memory>

namespace evs {

// A Python array that owns `data`.
template <class Out, class T>
Out owned(std::unique_ptr<T[]> data, size_t count) {
  nanobind::capsule owner(data.get(), [](void* p) noexcept { delete[] static_cast<T*>(p); });
  T* memory = data.release();
  return Out(memory, {count * sizeof(T) / sizeof(typename Out::Scalar)}, owner);
}

}  // namespace evs
