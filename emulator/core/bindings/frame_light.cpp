// The light of frames whose numbers are whole: a table for each channel.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <limits>
#include <stdexcept>

#include "bindings/gil.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace evs {
namespace {

using Numbers = nb::ndarray<nb::ro, nb::device::cpu>;
using Table = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Light = nb::ndarray<float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

template <class Number>
void look_up(const Numbers& numbers, const Table& tables, const Light& light) {
  const size_t height = light.shape(0), width = light.shape(1), entries = tables.shape(1);
  if (entries != size_t{std::numeric_limits<Number>::max()} + 1)
    throw std::invalid_argument("a table has to have an entry for each number");
  const Number* rows = static_cast<const Number*>(numbers.data());
  const float *first = tables.data(), *second = first + entries, *third = second + entries;
  const bool grey = numbers.ndim() == 2;
  const int64_t down = numbers.stride(0), across = numbers.stride(1);
  const int64_t channel = grey ? 0 : numbers.stride(2);
  for (size_t y = 0; y < height; y++) {
    const Number* pixel = rows + static_cast<int64_t>(y) * down;
    float* out = light.data() + y * width;
    if (grey && across == 1) {
      for (size_t x = 0; x < width; x++) out[x] = first[pixel[x]];
    } else if (grey) {
      for (size_t x = 0; x < width; x++, pixel += across) out[x] = first[*pixel];
    } else {
      for (size_t x = 0; x < width; x++, pixel += across)
        out[x] = first[pixel[0]] + second[pixel[channel]] + third[pixel[2 * channel]];
    }
  }
}

void light_of_numbers(const Numbers& numbers, const Table& tables, const Light& light) {
  const bool grey = numbers.ndim() == 2;
  const bool fits = grey || (numbers.ndim() == 3 && numbers.shape(2) >= 3);
  if (!fits || tables.shape(0) != (grey ? 1u : 3u) || numbers.shape(0) != light.shape(0) ||
      numbers.shape(1) != light.shape(1))
    throw std::invalid_argument("the frame, the tables and the light have to fit");
  const bool bytes = numbers.dtype() == nb::dtype<uint8_t>();
  if (!bytes && numbers.dtype() != nb::dtype<uint16_t>())
    throw std::invalid_argument("the frame has to be of uint8 or uint16");
  GilRelease released;
  bytes ? look_up<uint8_t>(numbers, tables, light) : look_up<uint16_t>(numbers, tables, light);
}

}  // namespace

void bind_frame_light(nb::module_& m) {
  m.def("light_of_numbers", &light_of_numbers, "numbers"_a, "tables"_a, "light"_a.noconvert(),
        "Look up the light of a frame.\n\n"
        "Args:\n"
        "    numbers: In, (h, w) or (h, w, 3 or more) uint8 or uint16, with any strides.\n"
        "    tables: In, (1 or 3, 256 or 65536) float32: light by number, for each channel.\n"
        "    light: Out, (h, w) float32: red + green, + blue, rounded twice.");
}

}  // namespace evs
