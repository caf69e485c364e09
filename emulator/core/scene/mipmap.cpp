#include "mipmap.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

constexpr float WEIGHTS[3] = {0.2126f, 0.7152f, 0.0722f};

// Downsample one image by area: (w, h) -> (w2, h2).
std::vector<float> shrink(const std::vector<float>& from, int w, int h, int w2, int h2) {
  auto spans = [](int n, int n2, auto&& each) {
    for (int i = 0; i < n2; i++) {
      double begin = static_cast<double>(i) * n / n2, end = static_cast<double>(i + 1) * n / n2;
      for (int k = static_cast<int>(begin); k < n && k < end; k++) {
        double share = std::min<double>(k + 1, end) - std::max<double>(k, begin);
        if (share > 0) each(i, k, share * n2 / n);
      }
    }
  };
  std::vector<double> rows(static_cast<size_t>(w2) * h), out(static_cast<size_t>(w2) * h2);
  for (int y = 0; y < h; y++) {
    spans(w, w2, [&](int i, int k, double share) { rows[y * w2 + i] += share * from[y * w + k]; });
  }
  spans(h, h2, [&](int i, int k, double share) {
    for (int x = 0; x < w2; x++) out[i * w2 + x] += share * rows[k * w2 + x];
  });
  return {out.begin(), out.end()};
}

}  // namespace

float from_srgb(float c) {
  return c <= 0.04045f ? c / 12.92f : static_cast<float>(std::pow((c + 0.055) / 1.055, 2.4));
}

namespace {

// Write one image and its rim. In: level (height, width).
void write_level(MipChain& chain, int channel, int level, int face,
                 const std::vector<float>& image) {
  const Texture& t = chain.layout;
  int w = t.level[level].width, h = t.level[level].height;
  auto inside = [&](int i, int n) {
    if (i >= 1 && i <= n) return i - 1;
    bool repeats = t.faces == 1;
    return (i < 1) == repeats ? n - 1 : 0;
  };
  for (int y = 0; y < h + 1; y++) {
    const float* row = image.data() + static_cast<long>(inside(y, h)) * w;
    const float* below = image.data() + static_cast<long>(inside(y + 1, h)) * w;
    float* to = chain.texels.data() + t.at(channel, level, face, y, 0);
    for (int x = 0; x < w + 2; x++) {
      to[2 * x] = row[inside(x, w)];
      to[2 * x + 1] = below[inside(x, w)];
    }
  }
}

// `texel(pixel, channel)`: the value of one texel, given its first component.
template <class Texel>
MipChain chain_of(const uint8_t* data, int faces, int height, int width, int components,
                  int channels, Texel&& texel) {
  MipChain chain;
  Texture& t = chain.layout;
  t.faces = faces;
  int w = width, h = height, total = 0;
  do {
    t.level[t.levels] = {w, h, total, w + 2};
    total += faces * (w + 2) * (h + 1);
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
      std::vector<float> level(static_cast<size_t>(width) * height);
      for (int i = 0; i < width * height; i++) {
        level[i] = texel(data + (static_cast<size_t>(face) * width * height + i) * components, c);
      }
      for (int l = 0;; l++) {
        write_level(chain, c, l, face, level);
        if (l + 1 >= t.levels) break;
        const TextureLevel &from = t.level[l], &to = t.level[l + 1];
        level = shrink(level, from.width, from.height, to.width, to.height);
      }
    }
  }
  // every level is an exact area mean, so the last, one texel, is the mean of the first
  for (int c = 0; c < std::min(channels, 3); c++) {
    double mean = 0;
    for (int face = 0; face < t.faces; face++) {
      mean += chain.texels[t.at(c, t.levels - 1, face, 1, 1)];
    }
    // the first channel is the luminance, unless there are three
    if (channels == 3 || c == 0) {
      t.mean += static_cast<float>(mean / t.faces) * (channels == 3 ? WEIGHTS[c] : 1.0f);
    }
  }
  return chain;
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
  return chain_of(data, faces, height, width, components, channels, [&](const uint8_t* p, int c) {
    float rgb[3];
    for (int k = 0; k < 3; k++) rgb[k] = decode.value[p[components >= 3 ? k : 0]] * tint[k];
    int k = channels == 1 ? -1 : c - (channels - 3);
    return k >= 0 ? rgb[k] : WEIGHTS[0] * rgb[0] + WEIGHTS[1] * rgb[1] + WEIGHTS[2] * rgb[2];
  });
}

MipChain build_scalar_mip_chain(const uint8_t* data, int faces, int height, int width,
                                int components, bool srgb) {
  Decode decode(srgb);
  return chain_of(data, faces, height, width, components, 1,
                  [&](const uint8_t* p, int) { return decode.value[*p]; });
}

MipChain build_normal_mip_chain(const uint8_t* data, int faces, int height, int width,
                                int components, bool srgb) {
  Decode decode(srgb);
  return chain_of(data, faces, height, width, components, 3, [&](const uint8_t* p, int c) {
    double n[3], square = 0;
    for (int k = 0; k < 3; k++) {
      n[k] = 2.0 * decode.value[p[k]] - 1.0;
      square += n[k] * n[k];
    }
    return static_cast<float>(n[c] / std::sqrt(square));
  });
}

}  // namespace evs
