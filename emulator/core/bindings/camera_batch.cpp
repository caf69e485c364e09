// Python binding of the cameras of many worlds: light and pixels of a tick of all of them in one
// call.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "bindings/bound_device.h"
#include "bindings/bound_readout.h"

namespace evs {
namespace {

// Of all worlds and cameras: geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat.
using PosesIn = std::tuple<In<double, N, N, 3>, In<double, N, N, 9>, In<double, N, N, 3>,
                           In<double, N, N, 3>, In<double, N, 3>, In<double, N, 9>>;
using Offsets = nb::ndarray<nb::numpy, int64_t, nb::ndim<1>>;

class CameraBatch {
 public:
  CameraBatch(int threads, int64_t start_us) : pool_(threads), start_us_(start_us) {}

  int add(int world) {
    require(world >= 0, "the world's number");
    Camera camera;
    camera.world = static_cast<size_t>(world);
    cameras_.push_back(std::move(camera));
    return static_cast<int>(cameras_.size()) - 1;
  }

  void put(int index, nb::object caster, Out<float, N, N> luminance, nb::object pixels,
           nb::dict state, int seed, int64_t clock_us, int64_t tick_us, int64_t ticks,
           bool all_due) {
    Camera& camera = cameras_.at(static_cast<size_t>(index));
    BoundCaster* renders = nb::cast<BoundCaster*>(caster);
    BoundPixels* bound = nb::cast<BoundPixels*>(pixels);
    require(renders->width == bound->width() && renders->height == bound->height(),
            "caster and pixels differ in size");
    require(luminance.shape(0) == renders->height && luminance.shape(1) == renders->width,
            "luminance is (height, width)");
    camera.arrays = bound->bind(state);
    camera.caster = renders;
    camera.luminance = luminance.data();
    camera.pixels = bound;
    camera.keep = nb::make_tuple(caster, luminance, pixels, state);
    camera.seed = seed;
    camera.clock_us = clock_us;
    camera.tick_us = tick_us;
    camera.ticks = ticks;
    camera.all_due = all_due;
    camera.clamped = 0;
    camera.events.clear();
    camera.readout = nullptr;
  }

  // A camera whose events pass through a readout.
  void put_readout(int index, nb::object readout, ClockArray clock, BytesIn waiting,
                   TimesIn due_ns) {
    Camera& camera = cameras_.at(static_cast<size_t>(index));
    require(camera.caster != nullptr, "a camera without its caster");
    BoundReadout* bound = nb::cast<BoundReadout*>(readout);
    camera.waiting = BoundReadout::requests_of(clock, waiting, due_ns);
    camera.readout = bound;
    camera.clock = clock.data();
    camera.keep_readout = nb::make_tuple(readout, clock);
  }

  // What waits in the readout of a camera now.
  nb::tuple waiting(int index) const {
    const Camera& camera = cameras_.at(static_cast<size_t>(index));
    auto [events, times] = BoundReadout::arrays_of(camera.waiting);
    return nb::make_tuple(events, times);
  }

  // A camera whose frames are rendered and whose pixels are stepped on a device.
  void put_on_device(int index, nb::object frame, uint64_t frame_constant, nb::object pixels,
                     uint64_t pixel_constant, nb::dict arrays) {
    Camera& camera = cameras_.at(static_cast<size_t>(index));
    require(camera.caster != nullptr, "a camera without its caster");
    Device device;
    device.frame = nb::cast<BoundDeviceFrame*>(frame);
    device.pixels = nb::cast<BoundDevicePixels*>(pixels);
    require(!device.frame->adaptive && &device.frame->caster == camera.caster,
            "a frame of the camera's caster, in one pass");
    device.frame_constant = frame_constant;
    device.pixel_constant = pixel_constant;
    device.arrays = device.pixels->needed(arrays);
    device.keep = nb::make_tuple(frame, pixels);
    camera.device = std::move(device);
  }

  // What `put` gave, as it is now: clock_us, tick_us, ticks; and pixels clamped since then.
  nb::tuple numbers(int index) const {
    const Camera& camera = cameras_.at(static_cast<size_t>(index));
    return nb::make_tuple(camera.clock_us, camera.tick_us, camera.ticks, camera.clamped);
  }

  void step(In<int32_t, N> which, const PosesIn& placed, In<int64_t, N> t_begin_us,
            int64_t tick_us) {
    const AllPoses poses = checked_poses(which, placed);
    require(t_begin_us.shape(0) == std::get<0>(placed).shape(0), "one time for each world");
    BoundPixels::check_tick_us(tick_us);
    GilRelease release;
    pool_.run(static_cast<int>(which.shape(0)), [&](int job, int) {
      const size_t index = static_cast<size_t>(which.data()[job]);
      Camera& camera = cameras_[index];
      camera.caster->caster.render(poses.of(camera, index), camera.luminance, nullptr);
      if (camera.tick_us != tick_us && camera.arrays.due_us) {
        // filters that stand still in short ticks may move in a longer one
        const size_t pixels = camera.pixels->width() * camera.pixels->height();
        std::fill_n(camera.arrays.due_us, (pixels + BLOCK_PIXELS - 1) / BLOCK_PIXELS,
                    camera.clock_us);
      }
      Tick tick{camera.luminance, camera.clock_us, static_cast<uint32_t>(tick_us)};
      tick.all_due = camera.all_due;
      size_t clamped = 0;
      const int64_t begin_us = t_begin_us.data()[camera.world];
      const EventBuffer found = camera.pixels->step(
          camera.arrays, tick, camera.stamps_from(begin_us, start_us_), camera.ticks, clamped);
      camera.take(found, clamped, begin_us, tick_us, start_us_);
    });
  }

  // Write what a device needs for a tick of some cameras.
  void lay_out(In<int32_t, N> which, const PosesIn& placed, int64_t tick_us, size_t first,
               uint64_t tick, uint64_t luminance, const DeviceRoom& room, Out<uint8_t, N, N> staged,
               Out<uint8_t, N, N> frames, Out<uint8_t, N, N> pixels) {
    const AllPoses poses = checked_poses(which, placed);
    BoundPixels::check_tick_us(tick_us);
    const size_t jobs = which.shape(0);
    for (size_t k = 0; k < jobs; k++) {
      const Camera& camera = checked(which, k);
      require(camera.device.frame != nullptr, "a camera without its device");
      require(camera.device.frame->frame.tick_bytes() <= staged.shape(1), "staged is too small");
    }
    require(staged.shape(0) >= jobs && frames.shape(0) >= jobs && pixels.shape(0) >= jobs &&
                frames.shape(1) == sizeof(DeviceArguments) + sizeof(uint64_t) &&
                pixels.shape(1) == sizeof(DevicePixels),
            "one row for each camera");
    GilRelease release;
    pool_.run(static_cast<int>(jobs), [&](int job, int) {
      const size_t k = static_cast<size_t>(job);
      const size_t index = static_cast<size_t>(which.data()[k]);
      const Camera& camera = cameras_[index];
      const Device& device = camera.device;
      const size_t block = k * staged.shape(1);
      DeviceArguments frame;
      device.frame->frame.copy_tick(poses.of(camera, index), device.frame_constant, tick + block,
                                    reinterpret_cast<char*>(staged.data()) + block, frame);
      const size_t count = camera.pixels->width() * camera.pixels->height();
      const uint64_t target = luminance + index * count * sizeof(float);
      uint8_t* row = frames.data() + k * frames.shape(1);
      std::memcpy(row, &frame, sizeof frame);
      std::memcpy(row + sizeof frame, &target, sizeof target);
      const size_t blocks = (count + BLOCK_PIXELS - 1) / BLOCK_PIXELS;
      const size_t before = (first + k) * blocks;
      Tick light{at<const float>(target), camera.clock_us, static_cast<uint32_t>(tick_us)};
      // filters that stand still in short ticks may move in a longer one
      light.all_due = camera.all_due || camera.tick_us != tick_us;
      const auto [crossings, crossing_room, candidates, candidate_room, counts] = room;
      const DeviceRoom own = {crossings + before * crossing_room * sizeof(Crossing), crossing_room,
                              candidates + before * candidate_room * sizeof(ShotCandidate),
                              candidate_room, counts + before * sizeof(BlockCounts)};
      const DevicePixels made =
          device.pixels->arguments(device.pixel_constant, device.arrays, light, camera.ticks, own);
      std::memcpy(pixels.data() + k * sizeof made, &made, sizeof made);
    });
  }

  // Take what the pixels of some cameras have found on a device in the tick that was laid out last.
  void take_tick(In<int32_t, N> which, In<uint8_t, N> crossings, In<uint32_t, N> begins,
                 In<int64_t, N> clamped, In<int64_t, N> t_begin_us, int64_t tick_us) {
    const size_t jobs = which.shape(0);
    require(begins.shape(0) == jobs + 1 && clamped.shape(0) == jobs, "one number for each camera");
    const size_t count = crossings.shape(0) / sizeof(Crossing);
    for (size_t k = 0; k < jobs; k++) {
      require(checked(which, k).world < t_begin_us.shape(0), "one time for each world");
      require(begins.data()[k] <= begins.data()[k + 1] && begins.data()[k + 1] <= count,
              "crossings camera after camera");
    }
    GilRelease release;
    pool_.run(static_cast<int>(jobs), [&](int job, int) {
      const size_t k = static_cast<size_t>(job);
      const size_t index = static_cast<size_t>(which.data()[k]);
      Camera& camera = cameras_[index];
      std::vector<std::vector<Crossing>> parts(1);
      parts[0].resize(begins.data()[k + 1] - begins.data()[k]);
      if (!parts[0].empty()) {
        std::memcpy(parts[0].data(), crossings.data() + begins.data()[k] * sizeof(Crossing),
                    parts[0].size() * sizeof(Crossing));
      }
      const int64_t begin_us = t_begin_us.data()[camera.world];
      const EventBuffer found = order_events(
          parts, camera.stamps_from(begin_us, start_us_), static_cast<uint32_t>(tick_us),
          static_cast<uint32_t>(camera.pixels->width()), camera.pixels->causes());
      camera.take(found, static_cast<size_t>(clamped.data()[k]), begin_us, tick_us, start_us_);
    });
  }

  // The events since the last call, camera after camera.
  nb::tuple take_events(In<int32_t, N> which) {
    const size_t count = which.shape(0);
    std::unique_ptr<int64_t[]> offsets(new int64_t[count + 1]);
    offsets[0] = 0;
    for (size_t k = 0; k < count; k++) {
      const Camera& camera = cameras_.at(static_cast<size_t>(which.data()[k]));
      offsets[k + 1] = offsets[k] + static_cast<int64_t>(camera.events.size());
    }
    const size_t total = static_cast<size_t>(offsets[count]);
    std::unique_ptr<Event[]> events(new Event[total]);
    for (size_t k = 0; k < count; k++) {
      Camera& camera = cameras_[static_cast<size_t>(which.data()[k])];
      std::copy(camera.events.begin(), camera.events.end(), events.get() + offsets[k]);
      // a burst does not keep its memory
      if (camera.events.capacity() > 65536) std::vector<Event>().swap(camera.events);
      camera.events.clear();
    }
    return nb::make_tuple(owned<Bytes>(std::move(events), total),
                          owned<Offsets>(std::move(offsets), count + 1));
  }

 private:
  // What a camera has on a device.
  struct Device {
    const BoundDeviceFrame* frame = nullptr;
    const BoundDevicePixels* pixels = nullptr;
    uint64_t frame_constant = 0, pixel_constant = 0;
    PixelArrays arrays;
    nb::object keep;
  };
  struct Camera {
    BoundCaster* caster = nullptr;
    BoundPixels* pixels = nullptr;
    float* luminance = nullptr;
    size_t world = 0;
    PixelArrays arrays;
    int seed = 0;  // of its light's noise
    int64_t clock_us = 0, tick_us = 0, ticks = 0, clamped = 0;
    bool all_due = false;
    std::vector<Event> events;
    nb::object keep;  // what owns the memory above
    Device device;
    BoundReadout* readout = nullptr;  // null: every event passes at its own time
    int64_t* clock = nullptr;         // of its state
    std::vector<Request> waiting;
    nb::object keep_readout;

    // What the stamps of the pixels count from: those of a readout are the world's own.
    int64_t stamps_from(int64_t begin_us, int64_t start_us) const {
      return readout ? begin_us : begin_us + start_us;
    }

    // A tick is over, in which so many pixels were clamped.
    void take(const EventBuffer& found, size_t bad, int64_t begin_us, int64_t us,
              int64_t start_us) {
      if (readout) {
        read_out(found, begin_us, begin_us + us, start_us);
      } else {
        events.insert(events.end(), found.events.get(), found.events.get() + found.count);
      }
      clamped += static_cast<int64_t>(bad);
      tick_us = us;
      clock_us += us;
      ticks++;
      all_due = false;
    }

    void read_out(const EventBuffer& found, int64_t begin_us, int64_t end_us, int64_t start_us) {
      EventBuffer out;
      try {
        if (end_us > MAX_TIME_US) throw std::invalid_argument("time is over 2^52 us");
        readout->step(found.events.get(), found.count, clock, waiting, begin_us, end_us, out);
      } catch (const std::invalid_argument& reason) {
        throw std::invalid_argument("readout of tick (" + std::to_string(begin_us) + ", " +
                                    std::to_string(end_us) + "] us: " + reason.what());
      }
      Event *first = out.events.get(), *end = first + out.count;
      for (Event* event = first; event < end; event++) event->t += start_us;
      events.insert(events.end(), first, end);
    }
  };
  // The poses of all worlds and cameras.
  struct AllPoses {
    const double *geom_pos, *geom_mat;
    size_t geoms;
    const double *light_pos, *light_dir;
    size_t lights;
    const double *camera_pos, *camera_mat;

    Poses of(const Camera& camera, size_t index) const {
      const size_t world = camera.world;
      return {geom_pos + 3 * geoms * world,
              geom_mat + 9 * geoms * world,
              light_pos + 3 * lights * world,
              light_dir + 3 * lights * world,
              camera_pos + 3 * index,
              camera_mat + 9 * index,
              camera.seed};
    }
  };

  // Camera k of those that are named.
  const Camera& checked(const In<int32_t, N>& which, size_t k) const {
    const int index = which.data()[k];
    require(index >= 0 && index < static_cast<int>(cameras_.size()) &&
                (k == 0 || index > which.data()[k - 1]),
            "cameras by their numbers, in order");
    const Camera& camera = cameras_[static_cast<size_t>(index)];
    require(camera.caster != nullptr, "a camera without its caster");
    return camera;
  }

  // The poses of a tick, which are those of all cameras, and of the worlds of those that are named.
  AllPoses checked_poses(const In<int32_t, N>& which, const PosesIn& placed) const {
    const auto& [geom_pos, geom_mat, light_pos, light_dir, camera_pos, camera_mat] = placed;
    const size_t worlds = geom_pos.shape(0), geoms = geom_pos.shape(1);
    const size_t lights = light_pos.shape(1);
    require(geom_mat.shape(0) == worlds && geom_mat.shape(1) == geoms &&
                light_pos.shape(0) == worlds && light_dir.shape(0) == worlds &&
                light_dir.shape(1) == lights,
            "poses of another number of worlds, geoms or lights");
    require(camera_pos.shape(0) == cameras_.size() && camera_mat.shape(0) == cameras_.size(),
            "one pose for each camera");
    for (size_t k = 0; k < which.shape(0); k++) {
      const Camera& camera = checked(which, k);
      require(
          camera.world < worlds && camera.caster->geoms == geoms && camera.caster->lights == lights,
          "poses for another number of geoms or lights");
    }
    return {geom_pos.data(),   geom_mat.data(),  geoms, light_pos.data(), light_dir.data(), lights,
            camera_pos.data(), camera_mat.data()};
  }

  // as MAX_TIME_US of emulator/sensor/readout.py
  static constexpr int64_t MAX_TIME_US = int64_t{1} << 52;

  ThreadPool pool_;
  int64_t start_us_;
  std::vector<Camera> cameras_;
};

}  // namespace

void bind_camera_batch(nb::module_& m) {
  nb::class_<CameraBatch>(m, "CameraBatch",
                          "Cameras of many worlds, whose ticks are computed side by side.\n"
                          "\n"
                          "Each has its own caster and pixels, made for one thread, or for all of\n"
                          "them where there are fewer cameras than threads.")
      .def(nb::init<int, int64_t>(), nb::kw_only(), nb::arg("threads"), nb::arg("start_us"),
           "Args:\n"
           "    threads: The number of cameras at once; 0 for one per core.\n"
           "    start_us: How much later than the time of their worlds events are stamped.")
      .def("add", &CameraBatch::add, nb::arg("world"),
           "Add a camera.\n"
           "\n"
           "Args:\n"
           "    world: The row of its world in the arrays of `step`.\n"
           "\n"
           "Returns:\n"
           "    Its number.")
      .def("put", &CameraBatch::put, nb::arg("camera"), nb::arg("caster"),
           nb::arg("luminance").noconvert(), nb::arg("pixels"), nb::arg("state"), nb::kw_only(),
           nb::arg("seed"), nb::arg("clock_us"), nb::arg("tick_us"), nb::arg("ticks"),
           nb::arg("all_due"),
           "Set what renders a camera, its pixels and their state, whose arrays are modified\n"
           "in place from now on.\n"
           "\n"
           "Args:\n"
           "    camera: Its number.\n"
           "    caster: What renders it.\n"
           "    luminance: (h, w) float32, the array that is passed to `Caster.render`.\n"
           "    pixels: The pixels.\n"
           "    state: The arrays of the state, by the names that `PixelArray.step` takes.\n"
           "    seed: The seed of its light's noise.\n"
           "    clock_us, ticks, all_due: See `PixelArray.step`.\n"
           "    tick_us: The length of the last tick.")
      .def("put_readout", &CameraBatch::put_readout, nb::arg("camera"), nb::arg("readout"),
           nb::arg("clock").noconvert(), nb::arg("waiting").noconvert(),
           nb::arg("due_ns").noconvert(),
           "After `put`: the events of the camera pass through a readout.\n"
           "\n"
           "Args:\n"
           "    camera: Its number.\n"
           "    readout: The Readout.\n"
           "    clock: See `Readout.step`. It is modified in place from now on.\n"
           "    waiting, due_ns: As there.")
      .def("waiting", &CameraBatch::waiting, nb::arg("camera"),
           "Return what waits in the readout of a camera: waiting and due_ns of `Readout.step`.")
      .def("put_on_device", &CameraBatch::put_on_device, nb::arg("camera"), nb::arg("frame"),
           nb::arg("frame_constant"), nb::arg("pixels"), nb::arg("pixel_constant"),
           nb::arg("arrays"),
           "After `put`: the camera is rendered, and its pixels are stepped, on a device.\n"
           "\n"
           "Args:\n"
           "    camera: Its number.\n"
           "    frame: DeviceFrame of its caster.\n"
           "    frame_constant: Where what stays of it lies on the device.\n"
           "    pixels: DevicePixels of its pixels.\n"
           "    pixel_constant: Where what stays of them lies.\n"
           "    arrays: Where each array of their state lies, by name.")
      .def("lay_out", &CameraBatch::lay_out, nb::arg("which"), nb::arg("poses"), nb::arg("tick_us"),
           nb::kw_only(), nb::arg("first"), nb::arg("tick"), nb::arg("luminance"), nb::arg("room"),
           nb::arg("staged"), nb::arg("frames"), nb::arg("pixels"),
           "Write what a device needs for a tick of some cameras.\n"
           "\n"
           "Args:\n"
           "    which, poses, tick_us: See `step`.\n"
           "    first: How many cameras of this tick were laid out before.\n"
           "    tick: Where `staged` will lie on the device.\n"
           "    luminance: Where the light of all cameras, (n, h, w) float32, will.\n"
           "    room: See DevicePixels.copy_arguments, camera after camera of the tick.\n"
           "    staged: (k, tick_bytes of the largest) uint8, the output: what the tick changes.\n"
           "    frames: (k, argument_bytes + 8) uint8, the output: a frame, and where its light "
           "goes.\n"
           "    pixels: (k, argument_bytes) uint8, the output: arguments of the pixels.")
      .def("take_tick", &CameraBatch::take_tick, nb::arg("which"), nb::arg("crossings"),
           nb::arg("begins"), nb::arg("clamped"), nb::arg("t_begin_us"), nb::arg("tick_us"),
           "Take what the pixels of some cameras have found on a device.\n"
           "\n"
           "Args:\n"
           "    which: (k,) int32, the cameras that were laid out last.\n"
           "    crossings: (8 n,) uint8, camera after camera.\n"
           "    begins: (k + 1,) uint32, where those of each begin, and n.\n"
           "    clamped: (k,) int64, pixels with unusable luminance.\n"
           "    t_begin_us, tick_us: See `step`.")
      .def("numbers", &CameraBatch::numbers, nb::arg("camera"),
           "Return clock_us, tick_us and ticks of a camera, and the pixels clamped since `put`.")
      .def("step", &CameraBatch::step, nb::arg("which"), nb::arg("poses"), nb::arg("t_begin_us"),
           nb::arg("tick_us"),
           "Render a tick of some cameras and step their pixels.\n"
           "\n"
           "Args:\n"
           "    which: (k,) int32, the numbers of the cameras, in order.\n"
           "    poses: geom_pos and geom_mat, (worlds, ng, 3) and (worlds, ng, 9); light_pos and\n"
           "        light_dir, (worlds, nl, 3); camera_pos and camera_mat, (cameras, 3) and\n"
           "        (cameras, 9); float64, world frame.\n"
           "    t_begin_us: (worlds,) int64, the time of each world at the start of the tick.\n"
           "    tick_us: The length of the tick.")
      .def("take_events", &CameraBatch::take_events, nb::arg("which"),
           "Take the events of some cameras since the last call.\n"
           "\n"
           "Args:\n"
           "    which: (k,) int32, the numbers of the cameras.\n"
           "\n"
           "Returns:\n"
           "    The event bytes, (16 n,) uint8, camera after camera, and (k + 1,) int64,\n"
           "    where those of each begin.");
}

}  // namespace evs
