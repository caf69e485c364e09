// What depends on a camera's optics alone: sub-pixel positions and the hull of each packet's rays.
#pragma once

#include <vector>

#include "scene.h"

namespace evs {

struct View {
  int width, height;
  double fx, fy, cx, cy;
  bool orthographic;
  int samples;
  bool adaptive;  // all samples only where neighbours differ, one elsewhere
  std::vector<float> lens = {}, share = {};  // as in Frame; empty: none
};

struct Sampling {
  std::vector<float> x, y;  // (samples) positions in the pixel, 0 ... 1
  std::vector<float> lens, share;
  std::vector<Hull> primary;  // (rows, columns) of packets
  int rows, columns;
};

// Positions in a pixel that never change, 0 ... 1. Out: x, y (count) each.
void sample_points(int count, std::vector<float>& x, std::vector<float>& y);

// Out: the sampling, and the camera's part of `frame`, which points into it.
void set_view(const View& view, Sampling& sampling, Frame& frame);

}  // namespace evs
