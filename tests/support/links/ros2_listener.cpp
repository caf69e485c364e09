// A node of ROS 2 on Fast DDS, which is its usual middleware: prints each message as a line of
// JSON. No code of ours, no Cyclone DDS: Fast DDS receives, Fast CDR decodes.
//
//   ros2_listener DOMAIN RELIABLE(0|1) PATH      e.g. ros2_listener 0 0 /camera
//
// Prints "ready" once its readers are there. When its input ends, so does it, once nothing comes.

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <iostream>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastrtps::types::ReturnCode_t;
using Payload = eprosima::fastrtps::rtps::SerializedPayload_t;
using Bytes = std::vector<uint8_t>;

// a message of any type, as the bytes that came
class RawType : public TopicDataType {
 public:
  explicit RawType(const std::string& name) {
    setName(name.c_str());
    m_typeSize = 1 << 16;  // grows with what comes
    m_isGetKeyDefined = false;
    auto_fill_type_information(false);
    auto_fill_type_object(false);
  }
  bool serialize(void*, Payload*) override { return false; }
  bool deserialize(Payload* payload, void* data) override {
    static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void*) override {
    return [] { return 0u; };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

// the fields of one message, in their order, as JSON
class Fields {
 public:
  explicit Fields(Bytes& bytes)
      : buffer_(reinterpret_cast<char*>(bytes.data()), bytes.size()),
        cdr_(buffer_, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR) {
    cdr_.read_encapsulation();
    out_.precision(17);
  }
  template <class Number>
  void number(const char* name) {
    Number value{};
    cdr_ >> value;
    out_ << ",\"" << name << "\":" << +value;
  }
  void text(const char* name) {
    std::string value;
    cdr_ >> value;
    out_ << ",\"" << name << "\":\"" << value << '"';
  }
  void numbers(const char* name, int count) {
    out_ << ",\"" << name << "\":[";
    for (int k = 0; k < count; ++k) {
      double value;
      cdr_ >> value;
      out_ << (k ? "," : "") << value;
    }
    out_ << "]";
  }
  void sequence(const char* name) {
    std::vector<double> values;
    cdr_ >> values;
    out_ << ",\"" << name << "\":[";
    for (size_t k = 0; k < values.size(); ++k) out_ << (k ? "," : "") << values[k];
    out_ << "]";
  }
  void bytes(const char* name) {
    Bytes values;
    cdr_ >> values;
    out_ << ",\"" << name << "\":\"";
    for (uint8_t one : values) out_ << digits_[one >> 4] << digits_[one & 15];
    out_ << '"';
  }
  void stamp() {
    int32_t seconds;
    uint32_t rest;
    cdr_ >> seconds >> rest;
    out_ << ",\"stamp\":" << int64_t(seconds) * 1000000000 + rest;
  }
  void header() {
    stamp();
    text("frame_id");
  }
  uint32_t count() {
    uint32_t value;
    cdr_ >> value;
    return value;
  }
  void raw(const std::string& text) { out_ << text; }
  std::string str() const { return out_.str(); }

 private:
  static constexpr const char* digits_ = "0123456789abcdef";
  eprosima::fastcdr::FastBuffer buffer_;
  Cdr cdr_;
  std::ostringstream out_;
};

using Decode = void (*)(Fields&);

void event_packet(Fields& f) {
  f.header();
  f.number<uint32_t>("height");
  f.number<uint32_t>("width");
  f.number<uint64_t>("seq");
  f.number<uint64_t>("time_base");
  f.text("encoding");
  f.number<bool>("is_bigendian");
  f.bytes("events");
}
void imu(Fields& f) {
  f.header();
  f.numbers("orientation", 4);
  f.numbers("orientation_covariance", 9);
  f.numbers("angular_velocity", 3);
  f.numbers("angular_velocity_covariance", 9);
  f.numbers("linear_acceleration", 3);
  f.numbers("linear_acceleration_covariance", 9);
}
void camera_info(Fields& f) {
  f.header();
  f.number<uint32_t>("height");
  f.number<uint32_t>("width");
  f.text("distortion_model");
  f.sequence("d");
  f.numbers("k", 9);
  f.numbers("r", 9);
  f.numbers("p", 12);
  f.number<uint32_t>("binning_x");
  f.number<uint32_t>("binning_y");
  for (auto name : {"x_offset", "y_offset", "roi_height", "roi_width"}) f.number<uint32_t>(name);
  f.number<bool>("do_rectify");
}
void image(Fields& f) {
  f.header();
  f.number<uint32_t>("height");
  f.number<uint32_t>("width");
  f.text("encoding");
  f.number<uint8_t>("is_bigendian");
  f.number<uint32_t>("step");
  f.bytes("data");
}
void pose(Fields& f) {
  f.header();
  f.numbers("position", 3);
  f.numbers("orientation", 4);
}
void transforms(Fields& f) {
  const uint32_t count = f.count();
  f.raw(",\"transforms\":[");
  for (uint32_t k = 0; k < count; ++k) {
    f.raw((k ? ",{\"place\":" : "{\"place\":") + std::to_string(k));
    f.header();
    f.text("child_frame_id");
    f.numbers("translation", 3);
    f.numbers("rotation", 4);
    f.raw("}");
  }
  f.raw("]");
}
void clock_time(Fields& f) { f.stamp(); }

std::atomic<int> came{0};
std::mutex printing;

class Listener : public DataReaderListener {
 public:
  Listener(std::string name, Decode decode) : name_(std::move(name)), decode_(decode) {}
  void on_data_available(DataReader* reader) override {
    Bytes bytes;
    SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK) {
      // what is overwritten while it is taken comes empty, without a sequence number
      if (!info.valid_data || bytes.empty()) continue;
      Fields fields(bytes);
      decode_(fields);
      std::lock_guard<std::mutex> one_at_a_time(printing);
      std::cout << "{\"topic\":\"" << name_ << '"' << fields.str() << "}\n";
      ++came;
    }
  }

 private:
  std::string name_;
  Decode decode_;
};

struct Wanted {
  std::string name, type;
  Decode decode;
  bool reliable;
  bool transient_local = false;
};

int main(int count, char** words) {
  if (count != 4) return 2;
  const bool reliable = words[2][0] == '1';
  const std::string path = words[3];
  // as ROS's own: tf2 asks for reliable writers, the clock never does; events last, so that
  // whoever waits for their reader has seen the others
  const std::vector<Wanted> all = {
      {"/clock", "rosgraph_msgs::msg::dds_::Clock_", clock_time, reliable},
      {"/tf", "tf2_msgs::msg::dds_::TFMessage_", transforms, true},
      {"/tf_static", "tf2_msgs::msg::dds_::TFMessage_", transforms, true, true},
      {path + "/imu", "sensor_msgs::msg::dds_::Imu_", imu, reliable},
      {path + "/camera_info", "sensor_msgs::msg::dds_::CameraInfo_", camera_info, reliable},
      {path + "/image_raw", "sensor_msgs::msg::dds_::Image_", image, reliable},
      {path + "/pose", "geometry_msgs::msg::dds_::PoseStamped_", pose, reliable},
      {path + "/events", "event_camera_msgs::msg::dds_::EventPacket_", event_packet, reliable},
  };
  DomainParticipantQos participant_qos;
  participant_qos.transport().listen_socket_buffer_size = 1 << 22;
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(
      std::stoi(words[1]), participant_qos);
  if (!participant) return 3;
  auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  std::vector<std::unique_ptr<Listener>> listeners;
  for (const Wanted& one : all) {
    TypeSupport type(new RawType(one.type));
    type.register_type(participant);
    auto* topic = participant->create_topic("rt" + one.name, one.type, TOPIC_QOS_DEFAULT);
    DataReaderQos qos;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = 1000;
    qos.reliability().kind = one.reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    if (one.transient_local) qos.durability().kind = TRANSIENT_LOCAL_DURABILITY_QOS;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    listeners.push_back(std::make_unique<Listener>(one.name, one.decode));
    if (!topic || !subscriber->create_datareader(topic, qos, listeners.back().get())) return 4;
  }
  std::cerr << "ready" << std::endl;
  while (std::cin.get() != std::istream::traits_type::eof()) continue;
  for (int before = -1; before != came;) {
    before = came;
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
  }
  std::lock_guard<std::mutex> no_more(printing);
  std::cout.flush();
  std::_Exit(0);
}
