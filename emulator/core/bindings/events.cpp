// Python binding of events: dense arrays of those of many worlds, and the check of a packet.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <vector>

#include "base/thread_pool.h"
#include "bindings/gil.h"
#include "bindings/values.h"
#include "sensor/event_arrays.h"
#include "sensor/events.h"

namespace evs {
namespace {

using Times = Array<const int64_t, 1>;

class EventArrays {
 public:
  explicit EventArrays(int threads) : pool_(threads), sums_(pool_.threads()) {}

  void voxel_grid(BytesIn events, Times offsets, Times begin_us, Times end_us, float limit,
                  Array<float, 4> out) {
    const size_t bins = out.shape(1);
    require(bins > 0, "a grid has bins");
    require(begin_us.shape(0) == out.shape(0) && end_us.shape(0) == out.shape(0),
            "one time for each world");
    const size_t size = bins * out.shape(2) * out.shape(3);
    run(events, offsets, out, 2,
        [&](const Event* first, size_t count, SensorSize sensor, size_t world, int worker) {
          fill_voxel_grid(first, count, begin_us.data()[world], end_us.data()[world], bins, sensor,
                          limit, sums_[static_cast<size_t>(worker)], out.data() + world * size);
        });
  }

  void event_frame(BytesIn events, Times offsets, Array<uint8_t, 4> out) {
    require(out.shape(1) == 2, "a frame has two polarities");
    const size_t size = 2 * out.shape(2) * out.shape(3);
    run(events, offsets, out, 2,
        [&](const Event* first, size_t count, SensorSize sensor, size_t world, int) {
          fill_event_frame(first, count, sensor, out.data() + world * size);
        });
  }

  void time_surface(BytesIn events, Times offsets, Array<int64_t, 4> stamps, double tau_us,
                    Times t_us, Array<float, 4> out) {
    require(out.shape(1) == 2, "a surface has two polarities");
    require(t_us.shape(0) == out.shape(0), "one time for each world");
    for (size_t k = 0; k < 4; k++) {
      require(stamps.shape(k) == out.shape(k), "stamps and surface differ in shape");
    }
    const size_t size = 2 * out.shape(2) * out.shape(3);
    run(events, offsets, out, 2,
        [&](const Event* first, size_t count, SensorSize sensor, size_t world, int) {
          int64_t* own = stamps.data() + world * size;
          keep_latest(first, count, sensor, own);
          fill_time_surface(own, size, tau_us, t_us.data()[world], out.data() + world * size);
        });
  }

  void packet(BytesIn events, Times offsets, Times t_us, Array<int32_t, 3> out) {
    require(out.shape(2) == 4, "a row has four numbers");
    require(t_us.shape(0) == out.shape(0), "one time for each world");
    const size_t capacity = out.shape(1);
    run(events, offsets, out, 0,
        [&](const Event* first, size_t count, SensorSize, size_t world, int) {
          fill_packet(first, count, capacity, t_us.data()[world],
                      out.data() + world * capacity * 4);
        });
  }

 private:
  // Call fill(events, count, sensor, world, worker) for each world. The sensor's height and width
  // are the dimensions of `out` from `image` on; 0: events may lie anywhere.
  template <class Out, class Fill>
  void run(const BytesIn& events, const Times& offsets, const Out& out, size_t image, Fill fill) {
    const size_t worlds = out.shape(0), total = events.shape(0) / sizeof(Event);
    require(offsets.shape(0) == worlds + 1, "offsets of another number of worlds");
    require(events.shape(0) % sizeof(Event) == 0, "events are 16 bytes each");
    const int64_t* begins = offsets.data();
    require(begins[0] == 0 && begins[worlds] == static_cast<int64_t>(total),
            "offsets begin at 0 and end at the last event");
    for (size_t k = 0; k < worlds; k++) require(begins[k] <= begins[k + 1], "offsets do not fall");
    const Event* all = reinterpret_cast<const Event*>(events.data());
    require(reinterpret_cast<uintptr_t>(all) % alignof(Event) == 0, "events are aligned");
    SensorSize sensor = {1, 1};
    if (image > 0) {
      sensor = {out.shape(image + 1), out.shape(image)};
      for (size_t i = 0; i < total; i++) {
        require(all[i].x >= 0 && all[i].y >= 0 && static_cast<size_t>(all[i].x) < sensor.width &&
                    static_cast<size_t>(all[i].y) < sensor.height,
                "an event lies outside the sensor");
      }
    }
    GilRelease release;
    pool_.run(static_cast<int>(worlds), [&](int job, int worker) {
      const size_t world = static_cast<size_t>(job);
      fill(all + begins[world], static_cast<size_t>(begins[world + 1] - begins[world]), sensor,
           world, worker);
    });
  }

  ThreadPool pool_;
  std::vector<std::vector<double>> sums_;  // scratch, of each worker
};

void decayed(Array<const int64_t, 1> stamps, double tau_us, int64_t t_us, Array<float, 1> out) {
  require(stamps.shape(0) == out.shape(0), "stamps and surface differ in length");
  fill_time_surface(stamps.data(), stamps.shape(0), tau_us, t_us, out.data());
}

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
  nb::class_<EventArrays>(
      m, "EventArrays",
      "Events of many worlds as dense arrays, written side by side.\n"
      "\n"
      "Each method takes the event bytes (16 n,) uint8, world after world, and offsets\n"
      "(worlds + 1,) int64, where those of each world begin.")
      .def(nb::init<int>(), nb::kw_only(), nb::arg("threads"),
           "Args:\n"
           "    threads: The number of worlds at once; 0 for one per core.")
      .def("voxel_grid", &EventArrays::voxel_grid, nb::arg("events"), nb::arg("offsets"),
           nb::arg("begin_us"), nb::arg("end_us"), nb::arg("limit"), nb::arg("out").noconvert(),
           "Write voxel grids.\n"
           "\n"
           "Args:\n"
           "    events, offsets: The events.\n"
           "    begin_us, end_us: (worlds,) int64, the time that the bins divide.\n"
           "    limit: The largest value.\n"
           "    out: (worlds, bins, h, w) float32, the output.")
      .def("event_frame", &EventArrays::event_frame, nb::arg("events"), nb::arg("offsets"),
           nb::arg("out").noconvert(),
           "Write event frames.\n"
           "\n"
           "Args:\n"
           "    events, offsets: The events.\n"
           "    out: (worlds, 2, h, w) uint8, the output; 255 is that or more.")
      .def("time_surface", &EventArrays::time_surface, nb::arg("events"), nb::arg("offsets"),
           nb::arg("stamps").noconvert(), nb::arg("tau_us"), nb::arg("t_us"),
           nb::arg("out").noconvert(),
           "Write time surfaces.\n"
           "\n"
           "Args:\n"
           "    events, offsets: The events.\n"
           "    stamps: (worlds, 2, h, w) int64, when each pixel last fired; modified in\n"
           "        place.\n"
           "    tau_us: The time constant.\n"
           "    t_us: (worlds,) int64, from when they are seen.\n"
           "    out: (worlds, 2, h, w) float32, the output.")
      .def("packet", &EventArrays::packet, nb::arg("events"), nb::arg("offsets"), nb::arg("t_us"),
           nb::arg("out").noconvert(),
           "Write padded packets.\n"
           "\n"
           "Args:\n"
           "    events, offsets: The events.\n"
           "    t_us: (worlds,) int64, what stamps are counted from.\n"
           "    out: (worlds, capacity, 4) int32, the output.");
  m.def("decayed", &decayed, nb::arg("stamps").noconvert(), nb::arg("tau_us"), nb::arg("t_us"),
        nb::arg("out").noconvert(),
        "Write a time surface of latest stamps.\n"
        "\n"
        "Args:\n"
        "    stamps: (n,) int64, us; the smallest int64 where there never was an event.\n"
        "    tau_us: The time constant.\n"
        "    t_us: From when it is seen.\n"
        "    out: (n,) float32, the output.");
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
