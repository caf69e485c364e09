// What depends on a camera's optics alone: sub-pixel positions and the hull of each packet's rays.
#pragma once

#include <vector>

#include "scene.h"

namespace evs {

struct Optics {
  int width, height;      // px
  double fx, fy, cx, cy;  // px; orthographic: fx and fy in px/m
  bool orthographic = false;
  std::vector<float> lens = {}, share = {};  // as in Frame; empty: none
};

struct Sampling {
  std::vector<float> x, y;  // (samples) positions in the pixel, 0 ... 1
  std::vector<float> lens, share;
  std::vector<Hull> primary;  // (rows, columns) of packets
  std::vector<Hull> pairs;    // (rows, columns / 2) of packets side by side; none if orthographic
  int rows, columns;
};

// Positions in a pixel that never change, 0 ... 1. Out: x, y (count) each.
void sample_points(int count, std::vector<float>& x, std::vector<float>& y);

// At how many points an image is read for each of so many samples a pixel, at most: together they
// lie as close along a pixel as those of one.
int probes_of(int samples);

// Out: the sampling, and the camera's part of `frame`, which points into it.
void set_optics(const Optics& optics, int samples, Sampling& sampling, Frame& frame);

}  // namespace evs
