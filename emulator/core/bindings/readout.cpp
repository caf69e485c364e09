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

BoundReadout* make_readout(int width, int height, double latency_us, double latency_sigma_us,
                           nb::object parameters, std::optional<FatesIn> fates) {
  ReadoutSettings settings;
  settings.width = width;
  settings.height = height;
  settings.latency_us = latency_us;
  settings.latency_sigma_us = latency_sigma_us;
  std::string order, scan_from, erc_drop, stamp;
  ArbiterTimes& arbiter = settings.arbiter;
  ScanTimes& scan = settings.scan;
  int64_t scan_us = 0;
  const Fields field(parameters);
  field("order", order);
  field("row_ns", arbiter.row_ns);
  field("column_ns", arbiter.column_ns);
  field("jitter_ns", arbiter.jitter_ns);
  field("phase_ns", arbiter.phase_ns);
  field("scan_us", scan_us);
  field("scan_column_ns", scan.column_ns);
  field("scan_from", scan_from);
  field("scan_every", scan.every);
  field("scan_events", scan.events);
  field("erc_target", settings.rate.target);
  field("erc_period_us", settings.rate.period_us);
  field("erc_drop", erc_drop);
  field("link_rate", settings.link.rate);
  field("fifo", settings.link.fifo);
  field("stamp", stamp);
  require(width > 0 && height > 0, "a sensor has pixels");
  require(scan_us > 0 && settings.rate.period_us > 0, "periods are over 0");
  require(order == "ideal" || order == "arbiter" || order == "scan",
          "the order is ideal, arbiter or scan");
  settings.order = order == "arbiter" ? ReadoutOrder::ARBITER
                   : order == "scan"  ? ReadoutOrder::SCAN
                                      : ReadoutOrder::IDEAL;
  require(arbiter.phase_ns >= 0 && arbiter.phase_ns < 1000, "a phase is within a us");
  require(scan_from == "left" || scan_from == "right", "a scan begins at the left or the right");
  require(scan.every > 0 && scan.events >= 0 && scan.column_ns >= 0, "a scan goes forward");
  require(order != "scan" || scan.column_ns * width <= scan_us * 1000,
          "the columns take longer than the scan");
  scan.scan_ns = scan_us * 1000;
  scan.from_right = scan_from == "right";
  require(erc_drop == "time" || erc_drop == "row" || erc_drop == "column",
          "the rate control drops in time, by row or by column");
  settings.rate.drop = erc_drop == "row"      ? ErcDrop::ROW
                       : erc_drop == "column" ? ErcDrop::COLUMN
                                              : ErcDrop::TIME;
  settings.link.stamp_sent = stamp == "sent";
  if (fates) {
    require(fates->shape(0) == static_cast<size_t>(height) &&
                fates->shape(1) == static_cast<size_t>(width),
            "the pixels' fates are (height, width)");
    settings.fates.assign(fates->data(), fates->data() + fates->size());
    for (uint8_t fate : settings.fates) {
      require(fate == DROP_ROI || fate == DROP_MASK || fate == KEPT,
              "a pixel's fate is 0, 1 or 255");
    }
  }
  return new BoundReadout(std::move(settings));
}

}  // namespace

void bind_readout(nb::module_& m) {
  nb::class_<BoundReadout>(m, "Readout",
                           "The readout, from pixel to packet (evs.emulator.sensor.readout).")
      .def(nb::new_(&make_readout), nb::arg("width"), nb::arg("height"), nb::arg("latency_us"),
           nb::arg("latency_sigma_us"), nb::arg("parameters"), nb::arg("fates").none() = nb::none(),
           "Args:\n"
           "    width, height: The size of the sensor, px.\n"
           "    latency_us, latency_sigma_us: The mean latency of a pixel and its jitter.\n"
           "    parameters: ReadoutParameters of emulator/sensor/parameters.py.\n"
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
