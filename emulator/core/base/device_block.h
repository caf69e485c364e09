// A block of a device's memory: arrays one after another, as they will lie from an address on.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace evs {

class DeviceBlock {
 public:
  // out: where they are copied to; null: they are only counted.
  DeviceBlock(uint64_t address, char* out) : address_(address), out_(out) {}

  uint64_t bytes() const { return bytes_; }

  // Append an array. Returns where it will lie.
  template <class T>
  const T* put(const T* from, size_t count) {
    if (!from || count == 0) return nullptr;
    constexpr uint64_t ALIGNMENT = 256;
    bytes_ = (bytes_ + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    uint64_t at = bytes_;
    bytes_ += count * sizeof(T);
    if (out_) std::memcpy(out_ + at, from, count * sizeof(T));
    return reinterpret_cast<const T*>(address_ + at);
  }

 private:
  uint64_t address_, bytes_ = 0;
  char* out_;
};

}  // namespace evs
