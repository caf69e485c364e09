// event_camera_codecs' decoders as a filter: packets in, events out. How to run it: README.md here.
//
//   codecs_oracle evt3|libcaer|libcaer_cmp|mono WIDTH HEIGHT < packets > events
//
// packets: {u64 time_base, u32 size, bytes}...; events: {u64 t, ns; u16 x; u16 y; u8 polarity}...
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

// the ROS message's part that decoders look at; one of their headers wants it by this name
namespace event_camera_codecs {
struct EventPacket {
    uint64_t time_base;
    std::vector<uint8_t> events;
};
}  // namespace event_camera_codecs

#include <event_camera_codecs/evt3_decoder.h>
#include <event_camera_codecs/libcaer_cmp_decoder.h>
#include <event_camera_codecs/libcaer_decoder.h>
#include <event_camera_codecs/mono_decoder.h>

using Message = event_camera_codecs::EventPacket;

struct Writer {
    void eventCD(uint64_t t, uint16_t x, uint16_t y, uint8_t polarity) {
        uint8_t row[13];
        std::memcpy(row, &t, 8);
        std::memcpy(row + 8, &x, 2);
        std::memcpy(row + 10, &y, 2);
        row[12] = polarity;
        std::fwrite(row, 1, sizeof row, stdout);
    }
    void eventExtTrigger(uint64_t, uint8_t, uint8_t) {}
    void finished() {}
    void rawData(const char*, size_t) {}
};

int main(int count, char** words) {
    namespace codecs = event_camera_codecs;
    if (count != 4) return 2;
    const std::string encoding = words[1];
    std::unique_ptr<codecs::Decoder<Message, Writer>> decoder;
    if (encoding == "evt3") decoder = std::make_unique<codecs::evt3::Decoder<Message, Writer>>();
    if (encoding == "libcaer")
        decoder = std::make_unique<codecs::libcaer::Decoder<Message, Writer>>();
    if (encoding == "libcaer_cmp") {
        decoder = std::make_unique<codecs::libcaer_cmp::Decoder<Message, Writer>>();
        // in ns its stamps leave 64 bits: it takes them for us
        decoder->setTimeMultiplier(1);
    }
    if (encoding == "mono") decoder = std::make_unique<codecs::mono::Decoder<Message, Writer>>();
    if (!decoder) return 2;
    decoder->setGeometry(std::atoi(words[2]), std::atoi(words[3]));
    Message message;
    Writer writer;
    uint32_t size = 0;
    while (std::fread(&message.time_base, 8, 1, stdin) == 1) {
        if (std::fread(&size, 4, 1, stdin) != 1) return 1;
        message.events.resize(size);
        if (size != 0 && std::fread(message.events.data(), size, 1, stdin) != 1) return 1;
        decoder->decode(message, &writer);
    }
    return 0;
}
