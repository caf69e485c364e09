#include "scene/optics.h"

#include <algorithm>
#include <cmath>

namespace evs {

void set_cells(int samples, Frame& frame) {
  const float across = std::sqrt(static_cast<float>(samples));
  frame.cell_x = 1.0f / (frame.fx * across);
  frame.cell_y = 1.0f / (frame.fy * across);
  frame.outline_reach = 0.525f * std::hypot(frame.cell_x, frame.cell_y);
}

namespace {

// Open a cone. Past 60 degrees it bounds everything.
void open_cone(RayCone& cone, double angle) {
  cone.cosine = static_cast<float>(std::cos(angle));
  cone.sine = static_cast<float>(std::sin(angle));
  if (!(cone.cosine > 0.5f)) cone.radius = 1e30f;
}

// Bound a packet's pixels, and what lies within `room` of them, rad, by a cone; orthographic: the
// pixels by a cylinder.
RayCone primary_cone(const Frame& f, double room, int column, int row) {
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
  RayCone cone = {};
  cone.length = 1e30f;
  if (f.orthographic) {
    cone.center = {static_cast<float>(d[4][0]), static_cast<float>(d[4][1]), 0};
    cone.axis = {0, 0, -1};
    // add the rounding of the rays' origins
    double away = std::abs(d[4][0]) + std::abs(d[4][1]);
    double x = d[0][0] - d[4][0], y = d[0][1] - d[4][1];
    cone.radius = static_cast<float>(std::sqrt(x * x + y * y) * 1.001 + away * 1e-6);
    cone.cosine = 1;
    return cone;
  }
  double least = 1;
  for (int i = 0; i < 4; i++)
    least = std::min(least, d[i][0] * d[4][0] + d[i][1] * d[4][1] + d[i][2] * d[4][2]);
  cone.axis = {static_cast<float>(d[4][0]), static_cast<float>(d[4][1]),
               static_cast<float>(d[4][2])};
  open_cone(cone, std::min(std::acos(std::min(least, 1.0)) * 1.001 + room + 1e-6, 1.5));
  return cone;
}

// Bound the rays at every pixel corner of a packet by a cone around their mean. The kernel
// interpolates between corners, and a cone narrower than a half space holds every interpolated ray.
RayCone lens_cone(const Frame& f, int column, int row) {
  constexpr int MOST = (PACKET_WIDTH + 1) * (PACKET_HEIGHT + 1);
  double d[MOST][3], axis[3] = {0, 0, 0};
  int count = 0;
  for (int j = 0; j <= PACKET_HEIGHT; j++) {
    for (int i = 0; i <= PACKET_WIDTH; i++) {
      int x = std::min(column * PACKET_WIDTH + i, f.width);
      int y = std::min(row * PACKET_HEIGHT + j, f.height);
      const float* ray = f.lens + 3 * (static_cast<size_t>(y) * (f.width + 1) + x);
      double n =
          std::sqrt(static_cast<double>(ray[0]) * ray[0] + static_cast<double>(ray[1]) * ray[1] +
                    static_cast<double>(ray[2]) * ray[2]);
      for (int a = 0; a < 3; a++) axis[a] += d[count][a] = ray[a] / n;
      count++;
    }
  }
  double n = std::sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
  double square = 0;
  for (double& a : axis) a /= std::max(n, 1e-30);
  for (int k = 0; k < count; k++) {
    double x = d[k][0] - axis[0], y = d[k][1] - axis[1], z = d[k][2] - axis[2];
    square = std::max(square, x * x + y * y + z * z);
  }
  RayCone cone = {};
  cone.length = 1e30f;
  cone.axis = {static_cast<float>(axis[0]), static_cast<float>(axis[1]),
               static_cast<float>(axis[2])};
  // chord to angle, with the slack of a pinhole's packet
  double angle = 2 * std::asin(std::min(0.5 * std::sqrt(square), 1.0)) * 1.001 + 1e-6;
  open_cone(cone, angle);
  return cone;
}

double angle_of(const RayCone& cone) { return std::atan2(cone.sine, cone.cosine); }

// Bound two cones with one apex.
RayCone cone_around(const RayCone& a, const RayCone& b) {
  double sum[3] = {a.axis.x + b.axis.x, a.axis.y + b.axis.y, a.axis.z + b.axis.z};
  double n = std::sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
  RayCone cone = a;
  cone.radius = std::max(a.radius, b.radius);
  cone.axis = {static_cast<float>(sum[0] / n), static_cast<float>(sum[1] / n),
               static_cast<float>(sum[2] / n)};
  // half the angle between the axes, from their chord, as their lengths are rounded
  double chord = std::hypot(a.axis.x - b.axis.x, a.axis.y - b.axis.y, a.axis.z - b.axis.z);
  double half_angle = std::asin(std::min(0.5 * chord, 1.0));
  open_cone(cone, half_angle * 1.001 + std::max(angle_of(a), angle_of(b)) + 1e-6);
  return cone;
}

}  // namespace

void sample_points(int count, std::vector<float>& x_at, std::vector<float>& y_at) {
  // Hammersley points with the first bit flipped: four of them are the rotated grid
  for (int i = 0; i < count; i++) {
    double y = 0;
    for (int bit = 1, n = i; n; n >>= 1, bit++) y += (n & 1) * std::ldexp(1.0, -bit);
    int power = 1;
    while (power < count) power *= 2;
    y += y < 0.5 ? 0.5 : -0.5;
    if (count == 1) y = 0;
    x_at.push_back(static_cast<float>((i + 0.5) / count));
    y_at.push_back(static_cast<float>(y + 0.5 / power));
  }
}

int probes_of(int samples) {
  constexpr int MOST = 8;
  return std::max(1, static_cast<int>(MOST / std::sqrt(static_cast<double>(samples))));
}

void set_edge_rays(Sampling& sampling, Frame& frame) {
  std::vector<float> x, y;
  sample_points(EDGE_RAYS, x, y);
  for (int cell = 0; cell < EDGE_CELLS; cell++) {
    for (int i = 0; i < EDGE_RAYS; i++) {
      if ((x[i] < 0.5f) + 2 * (y[i] < 0.5f) != cell) continue;
      sampling.edge_x.push_back(x[i]);
      sampling.edge_y.push_back(y[i]);
    }
  }
  frame.edge_x = sampling.edge_x.data();
  frame.edge_y = sampling.edge_y.data();
}

void set_optics(const Optics& optics, int samples, Sampling& sampling, Frame& frame) {
  Frame& f = frame;
  f.width = optics.width;
  f.height = optics.height;
  f.fx = static_cast<float>(optics.fx);
  f.fy = static_cast<float>(optics.fy);
  f.cx = static_cast<float>(optics.cx);
  f.cy = static_cast<float>(optics.cy);
  f.orthographic = optics.orthographic;
  f.near = static_cast<float>(optics.near);
  f.near_sphere = optics.near_sphere;
  sampling.lens = optics.lens;
  sampling.share = optics.share;
  f.lens = sampling.lens.empty() ? nullptr : sampling.lens.data();
  f.vignette = sampling.share.empty() ? nullptr : sampling.share.data();
  f.samples = samples;
  // four to a power: Hammersley points lie in square cells
  f.cells = 0;
  for (int side = 1; side * side <= samples; side *= 2) {
    if (side * side == samples) f.cells = side;
  }
  double across = std::sqrt(static_cast<double>(samples));
  f.pixel_angle = static_cast<float>(1.0 / (std::sqrt(optics.fx * optics.fy) * across));
  f.pixel_x = static_cast<float>(1.0 / (optics.fx * across));
  f.pixel_y = static_cast<float>(1.0 / (optics.fy * across));
  sample_points(samples, sampling.x, sampling.y);
  f.sample_x = sampling.x.data();
  f.sample_y = sampling.y.data();
  sampling.columns = (optics.width + PACKET_WIDTH - 1) / PACKET_WIDTH;
  sampling.rows = (optics.height + PACKET_HEIGHT - 1) / PACKET_HEIGHT;
  f.packet_columns = sampling.columns;
  // what the pixels at a packet's edge stand for
  Frame whole = f;
  set_cells(1, whole);
  const double room = static_cast<double>(OUTLINE_ROOM) * static_cast<double>(whole.outline_reach);
  for (int r = 0; r < sampling.rows; r++) {
    for (int c = 0; c < sampling.columns; c++) {
      sampling.primary.push_back(f.lens ? lens_cone(f, c, r) : primary_cone(f, room, c, r));
    }
  }
  f.primary = sampling.primary.data();
  for (int r = 0; r < sampling.rows && !f.orthographic; r++) {
    for (int c = 0; c + 1 < sampling.columns; c += 2) {
      const RayCone* left = f.primary + static_cast<size_t>(r) * sampling.columns + c;
      sampling.pairs.push_back(cone_around(left[0], left[1]));
    }
  }
  f.pairs = f.orthographic ? nullptr : sampling.pairs.data();
}

}  // namespace evs
