// Python binding of the check of the events of a packet, for drivers/bus/sockets.py.
#include <nanobind/nanobind.h>

#include "sensor/events.h"

namespace nb = nanobind;

namespace evs {
namespace {

// Takes a buffer, since the bytes from a socket need not be aligned.
bool events_fit_buffer(nb::handle raw, int64_t base_us, int64_t end_us, int64_t width,
                       int64_t height) {
  Py_buffer view;
  if (PyObject_GetBuffer(raw.ptr(), &view, PyBUF_SIMPLE) != 0) throw nb::python_error();
  const size_t size = static_cast<size_t>(view.len);
  const bool whole = size % sizeof(Event) == 0;
  const bool holds = whole && events_fit(static_cast<const uint8_t*>(view.buf),
                                         size / sizeof(Event), base_us, end_us, width, height);
  PyBuffer_Release(&view);
  return holds;
}

}  // namespace

void bind_events(nb::module_& m) {
  m.def("events_fit", &events_fit_buffer, nb::arg("raw"), nb::arg("base_us"), nb::arg("end_us"),
        nb::arg("width"), nb::arg("height"),
        nb::sig("def events_fit(raw: bytes | memoryview, base_us: int, end_us: int, width: int, "
                "height: int) -> bool"),
        "Return whether the bytes are valid events.\n"
        "\n"
        "They must hold whole events, sorted by t in (base_us, end_us], on the sensor,\n"
        "with polarity 0 or 1 and zero padding.");
}

}  // namespace evs
