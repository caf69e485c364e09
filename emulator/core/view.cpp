#include "view.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

// The pyramid of a packet's pixels as a cone; orthographic: the prism as a cylinder.
Hull primary_hull(const Frame& f, int column, int row) {
  double x0 = column * PACKET_WIDTH, x1 = x0 + PACKET_WIDTH, y0 = row * PACKET_HEIGHT,
         y1 = y0 + PACKET_HEIGHT;
  double xs[5] = {x0, x1, x0, x1, 0.5 * (x0 + x1)}, ys[5] = {y0, y0, y1, y1, 0.5 * (y0 + y1)};
  double d[5][3];
  for (int i = 0; i < 5; i++) {
    double x = (xs[i] - f.cx) / f.fx, y = (f.cy - ys[i]) / f.fy, z = -1;
    double n = f.orthographic ? 1 : std::sqrt(x * x + y * y + z * z);
    d[i][0] = x / n;
    d[i][1] = y / n;
    d[i][2] = z / n;
  }
  Hull hull = {};
  hull.length = 1e30f;
  if (f.orthographic) {
    hull.center = {static_cast<float>(d[4][0]), static_cast<float>(d[4][1]), 0};
    hull.axis = {0, 0, -1};
    // and the rounding of the rays' origins
    double away = std::abs(d[4][0]) + std::abs(d[4][1]);
    hull.radius =
        static_cast<float>(std::hypot(d[0][0] - d[4][0], d[0][1] - d[4][1]) * 1.001 + away * 1e-6);
    hull.cosine = 1;
    return hull;
  }
  double least = 1;
  for (int i = 0; i < 4; i++)
    least = std::min(least, d[i][0] * d[4][0] + d[i][1] * d[4][1] + d[i][2] * d[4][2]);
  hull.axis = {static_cast<float>(d[4][0]), static_cast<float>(d[4][1]),
               static_cast<float>(d[4][2])};
  // a pyramid that opens past 60 degrees: everything ahead and behind counts
  double angle = std::acos(std::min(least, 1.0)) * 1.001 + 1e-6;
  hull.cosine = static_cast<float>(std::cos(angle));
  hull.sine = static_cast<float>(std::sin(angle));
  if (!(hull.cosine > 0.5f)) hull.radius = 1e30f;
  return hull;
}

}  // namespace

void set_view(const View& view, Sampling& sampling, Frame& frame) {
  Frame& f = frame;
  f.width = view.width;
  f.height = view.height;
  f.fx = static_cast<float>(view.fx);
  f.fy = static_cast<float>(view.fy);
  f.cx = static_cast<float>(view.cx);
  f.cy = static_cast<float>(view.cy);
  f.orthographic = view.orthographic;
  f.samples = view.samples;
  double across = std::sqrt(static_cast<double>(view.samples));
  f.pixel_angle = static_cast<float>(1.0 / (std::sqrt(view.fx * view.fy) * across));
  // Hammersley points, the first bit flipped: four of them are the rotated grid
  for (int i = 0; i < view.samples; i++) {
    double y = 0;
    for (int bit = 1, n = i; n; n >>= 1, bit++) y += (n & 1) * std::ldexp(1.0, -bit);
    int power = 1;
    while (power < view.samples) power *= 2;
    y += y < 0.5 ? 0.5 : -0.5;
    if (view.samples == 1) y = 0;
    sampling.x.push_back(static_cast<float>((i + 0.5) / view.samples));
    sampling.y.push_back(static_cast<float>(y + 0.5 / power));
  }
  f.sample_x = sampling.x.data();
  f.sample_y = sampling.y.data();
  sampling.columns = (view.width + PACKET_WIDTH - 1) / PACKET_WIDTH;
  sampling.rows = (view.height + PACKET_HEIGHT - 1) / PACKET_HEIGHT;
  f.packet_columns = sampling.columns;
  for (int r = 0; r < sampling.rows; r++) {
    for (int c = 0; c < sampling.columns; c++) sampling.primary.push_back(primary_hull(f, c, r));
  }
  f.primary = sampling.primary.data();
}

}  // namespace evs
