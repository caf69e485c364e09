// What `direct` is asked for: packets of pixels, with a record of their rays or without, and pixels
// from anywhere.

// Pixels of 16 lanes are a packet, of 32 two side by side.
constexpr int PACKET = PACKET_WIDTH * PACKET_HEIGHT, PACKETS = LANES / PACKET;
struct PixelOfLane {
  float column[LANES], row[LANES];
  constexpr PixelOfLane() : column(), row() {
    for (int i = 0; i < LANES; i++) {
      column[i] = static_cast<float>(i / PACKET * PACKET_WIDTH + i % PACKET_WIDTH);
      row[i] = static_cast<float>(i % PACKET / PACKET_WIDTH);
    }
  }
};
constexpr PixelOfLane PIXEL;

// The call with as many channels as the frame has.
template <class Call>
EVS_INLINE void for_channels(const Frame& f, Call call) {
  switch (f.channels) {
    case 1:
      return call.template operator()<1>();
    case 2:
      return call.template operator()<2>();
    case 3:
      return call.template operator()<3>();
    case 4:
      return call.template operator()<4>();
    default:
      return call.template operator()<5>();
  }
}

// The rays through these points of the image, px.
EVS_INLINE Rays rays_through(const Frame& f, Float px, Float py) {
  Float zero = splat(0.0f), back = splat(-1.0f);
  if (f.lens) return {{zero, zero, zero}, through_lens(f, px, py), true, true};
  Float x = (px - f.cx) * (1.0f / f.fx), y = (f.cy - py) * (1.0f / f.fy);
  if (f.orthographic) return {{x, y, zero}, {zero, zero, back}, false, true};
  return {{zero, zero, zero}, normalize({x, y, back}), true, true};
}

// Sample positions of whole pixels, rounded as primary_rays rounds them.
EVS_INLINE Float pixel_point(const int* pixel, float sub, int packet) {
  alignas(64) float point[LANES];
  for (int i = 0; i < LANES; i++) {
    int within = pixel[i] % packet;
    point[i] = static_cast<float>(within) + (static_cast<float>(pixel[i] - within) + sub);
  }
  return load(point);
}

EVS_INLINE Rays primary_rays(const Frame& f, int column, int row, float sub_x, float sub_y) {
  // whole numbers below 2^24 and a sub-pixel position: the sums are rounded once
  return rays_through(f, load(PIXEL.column) + (static_cast<float>(column * PACKET_WIDTH) + sub_x),
                      load(PIXEL.row) + (static_cast<float>(row * PACKET_HEIGHT) + sub_y));
}

template <int CHANNELS>
EVS_INLINE Float luminance_of(const Frame& f, const Float* light) {
  Float luminance = light[0] * f.weights[0];
  if (CHANNELS >= 3 && f.colour == 0) {
    luminance = luminance + light[1] * f.weights[1] + light[2] * f.weights[2];
  }
  return luminance;
}

// Write the packets' pixels that lie in the image. In: light of the channels, mean of the samples.
template <int CHANNELS>
void write_pixels(const Frame& f, int column, int row, Float luminance, const Float* light,
                  const Outputs& out) {
  alignas(64) float grey[LANES], colour[3][LANES];
  store(grey, luminance);
  bool rgb = CHANNELS >= 3 && out.rgb;
  int x = column * PACKET_WIDTH, y = row * PACKET_HEIGHT;
  constexpr int WIDTH = PACKETS * PACKET_WIDTH;
  int columns = f.width - x < WIDTH ? f.width - x : WIDTH;
  int rows = f.height - y < PACKET_HEIGHT ? f.height - y : PACKET_HEIGHT;
  if (columns == WIDTH && !rgb && !out.plain && !f.share) {
    for (int j = 0; j < rows; j++) {
      float* to = out.luminance + static_cast<long>(y + j) * f.width + x;
      for (int p = 0; p < PACKETS; p++) {
        __builtin_memcpy(to + p * PACKET_WIDTH, grey + p * PACKET + j * PACKET_WIDTH,
                         PACKET_WIDTH * sizeof(float));
      }
    }
    return;
  }
  for (int c = 0; c < 3 && rgb; c++) store(colour[c], light[f.colour + c]);
  alignas(64) float plain[LANES];
  if (out.plain) store(plain, light[CHANNELS - 1]);
  for (int j = 0; j < rows; j++) {
    long at = static_cast<long>(y + j) * f.width + x;
    for (int i = 0; i < columns; i++) {
      int l = i / PACKET_WIDTH * PACKET + j * PACKET_WIDTH + i % PACKET_WIDTH;
      out.luminance[at + i] = shaded(f, at + i, grey[l]);
      for (int c = 0; c < 3 && rgb; c++) {
        out.rgb[3 * (at + i) + c] = shaded(f, at + i, colour[c][l]);
      }
      if (out.plain) out.plain[(y + j + 1) * out.plain_stride + (x + i + 1)] = plain[l];
    }
  }
}

template <int CHANNELS>
void trace_packet(const Frame& f, int column, int row, const Outputs& out, const Record* record) {
  const Hull& hull = PACKETS == 1 ? f.primary[row * f.packet_columns + column]
                                  : f.pairs[row * (f.packet_columns / 2) + column / 2];
  Float sum = splat(0.0f), sums[CHANNELS];
  for (int c = 0; c < CHANNELS; c++) sums[c] = sum;
  Notes notes;
  if (record && record->patch.numbers) {
    notes.keep = record->patch;
    *record->patch.geom = -1;
  }
  for (int s = 0; s < f.samples; s++) {
    Rays rays = primary_rays(f, column, row, f.sample_x[s], f.sample_y[s]);
    Float light[CHANNELS];
    radiance<CHANNELS, true>(f, rays, hull, mask_of(ALL_LANES), splat(0.0f),
                             record ? &notes : nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    if (out.rgb || out.plain) {
      for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] + light[c];
    }
  }
  if (record) write_record(notes, *record);
  float share = 1.0f / static_cast<float>(f.samples);
  for (int c = 0; c < CHANNELS; c++) sums[c] = sums[c] * share;
  write_pixels<CHANNELS>(f, column, row, sum * share, sums, out);
}

inline void trace(const Frame& f, int column, int row, const Outputs& out, const Record* record) {
  for_channels(f, [&]<int CHANNELS>() { trace_packet<CHANNELS>(f, column, row, out, record); });
}

// Up to 16 pixels in 16 lanes: the last one stands in for the lanes that are left over.
inline void fill_lanes(const int32_t* x, const int32_t* y, int count, int* column, int* row) {
  for (int i = 0; i < LANES; i++) {
    column[i] = x[i < count ? i : count - 1];
    row[i] = y[i < count ? i : count - 1];
  }
}

// Pixels from anywhere: their rays share no more than the camera, so their hull is wide.
template <int CHANNELS>
void trace_any(const Frame& f, const int32_t* x, const int32_t* y, int count, float* luminance,
               float* plain) {
  alignas(64) int column[LANES], row[LANES];
  fill_lanes(x, y, count, column, row);
  Float sum = splat(0.0f), sum_plain = sum;
  Mask all = mask_of(ALL_LANES);
  for (int s = 0; s < f.samples; s++) {
    Rays rays = rays_through(f, pixel_point(column, f.sample_x[s], PACKET_WIDTH),
                             pixel_point(row, f.sample_y[s], PACKET_HEIGHT));
    Float light[CHANNELS];
    radiance<CHANNELS, true>(f, rays, hull_of(rays.origin, rays.direction, all, FAR), all,
                             splat(0.0f), nullptr, light);
    sum = sum + luminance_of<CHANNELS>(f, light);
    sum_plain = sum_plain + light[CHANNELS - 1];
  }
  alignas(64) float out[LANES];
  store(out, sum * (1.0f / static_cast<float>(f.samples)));
  for (int i = 0; i < count; i++) {
    luminance[i] = shaded(f, static_cast<long>(y[i]) * f.width + x[i], out[i]);
  }
  if (!plain) return;
  store(out, sum_plain * (1.0f / static_cast<float>(f.samples)));
  for (int i = 0; i < count; i++) plain[i] = out[i];
}

inline void trace_pixels(const Frame& f, const int32_t* x, const int32_t* y, int count,
                         float* luminance, float* plain) {
  for_channels(f, [&]<int CHANNELS>() { trace_any<CHANNELS>(f, x, y, count, luminance, plain); });
}
