#include "environment.h"

#include <cmath>

namespace evs {
namespace {

constexpr int WIDEST = 64;  // texels across a face: finer than anything that order 2 can resolve

// solid angle of the face's corner (0, 0) ... (s, t), seen from the cube's centre
double corner_angle(double s, double t) { return std::atan2(s * t, std::sqrt(s * s + t * t + 1)); }

// direction in the world of a point on a face (-1 ... 1): the inverse of cube_coordinates(), y up
// in the image
void direction_of(int face, double s, double t, double* d) {
  double axes[6][3] = {{1, -t, -s}, {-1, -t, s}, {s, 1, t}, {s, -1, -t}, {s, -t, 1}, {-s, -t, -1}};
  const double* q = axes[face];
  double n = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
  d[0] = q[0] / n;
  d[1] = -q[2] / n;
  d[2] = q[1] / n;
}

void basis_of(const double* d, double* y) {
  double x = d[0], v = d[1], z = d[2];
  double values[9] = {1, v, z, x, x * v, v * z, 3 * z * z - 1, x * z, x * x - v * v};
  for (int i = 0; i < 9; i++) y[i] = values[i];
}

// squared norm of each basis function over the sphere, times 1 / (4 pi)
constexpr double NORM[9] = {1,        1.0 / 3, 1.0 / 3,  1.0 / 3, 1.0 / 15,
                            1.0 / 15, 4.0 / 5, 1.0 / 15, 4.0 / 15};
// attenuation of each order by the cosine lobe, over pi
constexpr double LOBE[9] = {1, 2.0 / 3, 2.0 / 3, 2.0 / 3, 0.25, 0.25, 0.25, 0.25, 0.25};

}  // namespace

void project_irradiance(const MipChain& image, int channel, float* factors) {
  const Texture& t = image.layout;
  int level = 0;
  while (level + 1 < t.levels && t.level[level].width > WIDEST) level++;
  int w = t.level[level].width, h = t.level[level].height;
  double sum[9] = {}, sphere = 0;
  for (int face = 0; face < 6; face++) {
    for (int y = 0; y < h; y++) {
      for (int x = 0; x < w; x++) {
        double s0 = 2.0 * x / w - 1, s1 = 2.0 * (x + 1) / w - 1;
        double t0 = 2.0 * y / h - 1, t1 = 2.0 * (y + 1) / h - 1;
        double angle = corner_angle(s1, t1) - corner_angle(s0, t1) - corner_angle(s1, t0) +
                       corner_angle(s0, t0);
        double d[3], basis[9];
        direction_of(face, 0.5 * (s0 + s1), 0.5 * (t0 + t1), d);
        basis_of(d, basis);
        double light = image.texels[t.at(channel, level, face, y + 1, x + 1)] * angle;
        for (int i = 0; i < 9; i++) sum[i] += light * basis[i];
        sphere += angle;
      }
    }
  }
  for (int i = 0; i < 9; i++) {
    factors[i] = static_cast<float>(sum[i] / sphere / NORM[i] * LOBE[i]);
  }
}

}  // namespace evs
