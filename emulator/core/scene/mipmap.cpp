#include "scene/mipmap.h"

#include <algorithm>
#include <cmath>

#include "scene/checkerboard.h"

namespace evs {
namespace {

constexpr float WEIGHTS[3] = {0.2126f, 0.7152f, 0.0722f};

// 2D images of so many texels keep bytes instead of the numbers of level 0.
constexpr long LARGE = 1L << 22;

// Downsample one image by area: (w, h) -> (w2, h2). In: row(y, out) writes a row of it.
template <class Row>
std::vector<float> shrink(const Row& row, int w, int h, int w2, int h2) {
  auto span = [](int n, int n2, int i, auto&& each) {
    double begin = static_cast<double>(i) * n / n2, end = static_cast<double>(i + 1) * n / n2;
    for (int k = static_cast<int>(begin); k < n && k < end; k++) {
      double share = std::min<double>(k + 1, end) - std::max<double>(k, begin);
      if (share > 0) each(k, share * n2 / n);
    }
  };
  std::vector<float> from(static_cast<size_t>(w)), out;
  std::vector<double> narrow(static_cast<size_t>(w2)), sum(narrow.size());
  out.reserve(static_cast<size_t>(w2) * h2);
  int held = -1;
  for (int i = 0; i < h2; i++) {
    std::fill(sum.begin(), sum.end(), 0.0);
    span(h, h2, i, [&](int k, double share) {
      if (held != k) {
        row(k, from.data());
        for (int x = 0; x < w2; x++) {
          narrow[x] = 0;
          span(w, w2, x, [&](int at, double part) { narrow[x] += part * from[at]; });
        }
        held = k;
      }
      for (int x = 0; x < w2; x++) sum[x] += share * narrow[x];
    });
    out.insert(out.end(), sum.begin(), sum.end());
  }
  return out;
}

}  // namespace

float from_srgb(float c) {
  return c <= 0.04045f ? c / 12.92f : static_cast<float>(std::pow((c + 0.055) / 1.055, 2.4));
}

namespace {

// Write one image and its rim. In: row(y, out) writes a row of it.
template <class Row>
void write_level(MipChain& chain, int channel, int level, int face, const Row& row) {
  const Texture& t = chain.layout;
  int w = t.level[level].width, h = t.level[level].height;
  auto inside = [&](int i, int n) {
    if (i >= 1 && i <= n) return i - 1;
    bool repeats = t.faces == 1;
    return (i < 1) == repeats ? n - 1 : 0;
  };
  std::vector<float> here(static_cast<size_t>(w)), below(here.size());
  row(inside(0, h), below.data());
  for (int y = 0; y < h + 1; y++) {
    here.swap(below);
    row(inside(y + 1, h), below.data());
    float* to = chain.texels.data() + t.at(channel, level, face, y, 0);
    for (int x = 0; x < w + 2; x++) {
      to[2 * x] = here[inside(x, w)];
      to[2 * x + 1] = below[inside(x, w)];
    }
  }
}

struct RowsOf {
  const std::vector<float>& image;
  int width;

  void operator()(int y, float* out) const {
    std::copy_n(image.data() + static_cast<size_t>(y) * width, width, out);
  }
};

// `texel(pixel, channel)`: the value of one texel, given its first component. `bytes`: whether
// level 0 is kept elsewhere.
template <class Texel>
MipChain chain_of(const uint8_t* data, int faces, int height, int width, int components,
                  int channels, bool bytes, Texel&& texel) {
  MipChain chain;
  Texture& t = chain.layout;
  t.faces = faces;
  int w = width, h = height, total = 0;
  do {
    t.level[t.levels] = {w, h, total, w + 2};
    if (t.levels > 0 || !bytes) total += faces * (w + 2) * (h + 1);
    t.levels++;
    if (w == 1 && h == 1) break;
    w = std::max(1, w / 2);
    h = std::max(1, h / 2);
  } while (t.levels < MAX_LEVELS);
  t.channel_stride = total;
  t.channels = channels;
  chain.texels.resize(2 * static_cast<size_t>(total) * channels);

  for (int c = 0; c < channels; c++) {
    for (int face = 0; face < faces; face++) {
      auto whole = [&](int y, float* out) {
        size_t first = (static_cast<size_t>(face) * height + y) * width;
        for (int x = 0; x < width; x++) out[x] = texel(data + (first + x) * components, c);
      };
      if (!bytes) write_level(chain, c, 0, face, whole);
      std::vector<float> image;
      for (int l = 1; l < t.levels; l++) {
        const TextureLevel &from = t.level[l - 1], &to = t.level[l];
        image = l == 1 ? shrink(whole, from.width, from.height, to.width, to.height)
                       : shrink(RowsOf{image, from.width}, from.width, from.height, to.width,
                                to.height);
        write_level(chain, c, l, face, RowsOf{image, to.width});
      }
    }
  }
  // every level is an exact area mean, so the last, one texel, is the mean of the first
  for (int c = 0; c < std::min(channels, 3); c++) {
    double mean = 0;
    for (int face = 0; face < faces; face++) {
      mean += chain.texels[t.at(c, t.levels - 1, face, 1, 1)];
    }
    // the first channel is the luminance, unless there are three
    if (channels == 3 || c == 0) {
      t.mean += static_cast<float>(mean / t.faces) * (channels == 3 ? WEIGHTS[c] : 1.0f);
    }
  }
  return chain;
}

// Texture::bend of a cube. Across its edges the slope may turn round.
float bend_of(const MipChain& chain) {
  constexpr float DN = 1.0f / 255;
  const Texture& t = chain.layout;
  const int w = t.level[0].width, h = t.level[0].height;
  float most = 0;
  for (int c = 0; c < t.channels; c++) {
    for (int face = 0; face < t.faces; face++) {
      auto value = [&](int y, int x) { return chain.texels[t.at(c, 0, face, y + 1, x + 1)]; };
      for (int y = 0; y < h; y++) {
        for (int x = 0; x < w; x++) {
          const float own = value(y, x);
          auto turn = [own](float before, float after, bool edge) {
            const float rise = after - own, fall = own - before;
            return edge ? 2 * (std::fabs(rise) + std::fabs(fall)) : std::fabs(rise - fall);
          };
          const float across = turn(value(y, std::max(x - 1, 0)), value(y, std::min(x + 1, w - 1)),
                                    x == 0 || x == w - 1);
          const float down = turn(value(std::max(y - 1, 0), x), value(std::min(y + 1, h - 1), x),
                                  y == 0 || y == h - 1);
          most = std::max(most, (across + down) / (own + DN));
        }
        if (!(most < 1)) return 1;
      }
    }
  }
  return most;
}

struct Decode {
  float value[256];
  explicit Decode(bool srgb) {
    for (int i = 0; i < 256; i++) {
      float coded = static_cast<float>(i) / 255.0f;
      value[i] = srgb ? from_srgb(coded) : coded;
    }
  }
};

}  // namespace

MipChain build_mip_chain(const uint8_t* data, int faces, int height, int width, int components,
                         bool srgb, const float* tint, int channels) {
  Decode decode(srgb);
  const bool bytes = faces == 1 && static_cast<long>(height) * width >= LARGE;
  auto component = [&](const uint8_t* p, int k) { return p[components >= 3 ? k : 0]; };
  auto texel = [&](const uint8_t* p, int c) {
    float rgb[3];
    for (int k = 0; k < 3; k++) rgb[k] = decode.value[component(p, k)] * tint[k];
    int k = channels == 1 ? -1 : c - (channels - 3);
    return k >= 0 ? rgb[k] : WEIGHTS[0] * rgb[0] + WEIGHTS[1] * rgb[1] + WEIGHTS[2] * rgb[2];
  };
  MipChain chain = chain_of(data, faces, height, width, components, channels, bytes, texel);
  if (faces == 1) find_tiles(data, height, width, components, texel, chain.layout);
  if (faces == 6) chain.layout.bend = bend_of(chain);
  if (!bytes) return chain;
  for (int k = 0; k < 3; k++) {
    for (float value : decode.value) chain.decoded.push_back(value * tint[k]);
  }
  chain.words.reserve(static_cast<size_t>(width + 2) * (height + 2));
  for (int y = 0; y < height + 2; y++) {
    const uint8_t* row = data + static_cast<size_t>((y + height - 1) % height) * width * components;
    for (int x = 0; x < width + 2; x++) {
      const uint8_t* p = row + static_cast<size_t>((x + width - 1) % width) * components;
      chain.words.push_back(component(p, 0) | component(p, 1) << 8 | component(p, 2) << 16);
    }
  }
  return chain;
}

MipChain build_scalar_mip_chain(const uint8_t* data, int faces, int height, int width,
                                int components, bool srgb) {
  Decode decode(srgb);
  return chain_of(data, faces, height, width, components, 1, false,
                  [&](const uint8_t* p, int) { return decode.value[*p]; });
}

MipChain build_normal_mip_chain(const uint8_t* data, int faces, int height, int width,
                                int components, bool srgb) {
  Decode decode(srgb);
  return chain_of(data, faces, height, width, components, 3, false, [&](const uint8_t* p, int c) {
    double n[3], square = 0;
    for (int k = 0; k < 3; k++) {
      n[k] = 2.0 * decode.value[p[k]] - 1.0;
      square += n[k] * n[k];
    }
    return static_cast<float>(n[c] / std::sqrt(square));
  });
}

}  // namespace evs
