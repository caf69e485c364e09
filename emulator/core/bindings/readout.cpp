// Python binding of the readout, for emulator/sensor/readout.py.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <optional>

#include "bindings/bound_readout.h"

namespace nb = nanobind;

namespace evs {
namespace {

using FatesIn = nb::ndarray<const uint8_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

void require(bool holds, const char* what) {
  if (!holds) throw std::invalid_argument(what);
}

BoundReadout* make_readout(int width, int height, double latency_us, double latency_sigma_us,
                           const std::string& order, int64_t row_ns, int64_t column_ns,
                           double jitter_ns, int64_t phase_ns, int64_t scan_us,
                           int64_t scan_column_ns, const std::string& scan_from, int64_t scan_every,
                           int64_t scan_events, int64_t erc_target, int64_t erc_period_us,
                           const std::string& erc_drop, int64_t link_rate, int64_t fifo,
                           bool stamp_sent, std::optional<FatesIn> fates) {
  require(width > 0 && height > 0, "a sensor has pixels");
  require(scan_us > 0 && erc_period_us > 0, "periods are over 0");
  ReadoutSettings settings;
  settings.width = width;
  settings.height = height;
  settings.latency_us = latency_us;
  settings.latency_sigma_us = latency_sigma_us;
  require(order == "ideal" || order == "arbiter" || order == "scan",
          "the order is ideal, arbiter or scan");
  settings.order = order == "arbiter" ? ReadoutOrder::arbiter
                   : order == "scan"  ? ReadoutOrder::scan
                                      : ReadoutOrder::ideal;
  require(phase_ns >= 0 && phase_ns < 1000, "a phase is within a us");
  settings.arbiter = ArbiterTimes{row_ns, column_ns, jitter_ns, phase_ns};
  require(scan_from == "left" || scan_from == "right", "a scan begins at the left or the right");
  require(scan_every > 0 && scan_events >= 0 && scan_column_ns >= 0, "a scan goes forward");
  require(order != "scan" || scan_column_ns * width <= scan_us * 1000,
          "the columns take longer than the scan");
  settings.scan =
      ScanTimes{scan_us * 1000, scan_column_ns, scan_from == "right", scan_every, scan_events};
  require(erc_drop == "time" || erc_drop == "row" || erc_drop == "column",
          "the rate control drops in time, by row or by column");
  settings.rate = RateControl{erc_target, erc_period_us,
                              erc_drop == "row"      ? ErcDrop::row
                              : erc_drop == "column" ? ErcDrop::column
                                                     : ErcDrop::time};
  settings.link = Link{link_rate, fifo, stamp_sent};
  if (fates) {
    require(fates->shape(0) == static_cast<size_t>(height) &&
                fates->shape(1) == static_cast<size_t>(width),
            "the pixels' fates are (height, width)");
    settings.fates.assign(fates->data(), fates->data() + fates->size());
    for (uint8_t fate : settings.fates) {
      require(fate == DropRoi || fate == DropMask || fate == kKept,
              "a pixel's fate is 0, 1 or 255");
    }
  }
  return new BoundReadout(std::move(settings));
}

}  // namespace

void bind_readout(nb::module_& m) {
  nb::class_<BoundReadout>(m, "Readout",
                           "The readout, from pixel to packet (evs.emulator.sensor.readout).")
      .def(nb::new_(&make_readout), nb::kw_only(), nb::arg("width"), nb::arg("height"),
           nb::arg("latency_us"), nb::arg("latency_sigma_us"), nb::arg("order"), nb::arg("row_ns"),
           nb::arg("column_ns"), nb::arg("jitter_ns"), nb::arg("phase_ns"), nb::arg("scan_us"),
           nb::arg("scan_column_ns"), nb::arg("scan_from"), nb::arg("scan_every"),
           nb::arg("scan_events"), nb::arg("erc_target"), nb::arg("erc_period_us"),
           nb::arg("erc_drop"), nb::arg("link_rate"), nb::arg("fifo"), nb::arg("stamp_sent"),
           nb::arg("fates").none() = nb::none(),
           "Args:\n"
           "    width, height: The size of the sensor, px.\n"
           "    latency_us, latency_sigma_us: The mean latency of a pixel and its jitter.\n"
           "    order: ideal, arbiter or scan.\n"
           "    row_ns, column_ns, jitter_ns, phase_ns: The times of the arbiter.\n"
           "    scan_us, scan_column_ns: The period of the scan; the time of a column, 0 for the\n"
           "        whole array at once.\n"
           "    scan_from: The side at which a scan begins: left or right.\n"
           "    scan_every: Which scans are read: those with a multiple of this as number.\n"
           "    scan_events: The events that a scan can read in its period; 0 for any number.\n"
           "    erc_target: The event rate control's limit, events per period; 0 for none.\n"
           "    erc_period_us: The period of the rate control.\n"
           "    erc_drop: What the rate control thins: time, row or column.\n"
           "    link_rate: The bandwidth of the link, events per second; 0 for unlimited.\n"
           "    fifo: The events that the FIFO of the link holds.\n"
           "    stamp_sent: Whether an event is stamped when it is sent, not when it is\n"
           "        read.\n"
           "    fates: (height, width) uint8: 0 outside the ROI, 1 masked, 255 read out;\n"
           "        None reads out every pixel.")
      .def("step", &BoundReadout::step_tick, nb::arg("events").noconvert(),
           nb::arg("clock").noconvert(), nb::arg("waiting").noconvert(),
           nb::arg("due_ns").noconvert(), nb::arg("t_begin_us"), nb::arg("t_end_us"),
           "Read out the events of one tick.\n"
           "\n"
           "Args:\n"
           "    events: (16 n,) uint8, the events of the pixels, sorted.\n"
           "    clock: The int64 state, modified in place.\n"
           "    waiting, due_ns: The waiting events and their times, as the last call\n"
           "        returned them.\n"
           "    t_begin_us, t_end_us: The tick.\n"
           "\n"
           "Returns:\n"
           "    The bytes of the events that are output in the tick, (16 n,) uint8; of\n"
           "    those that wait, (16 m,) uint8; and the times of these, (m,) int64, ns.");
}

}  // namespace evs
