// What depends on the camera's optics only: sample positions and the bounding cone of each packet's
// rays.
#pragma once

#include <vector>

#include "scene/scene.h"

namespace evs {

struct Optics {
  int width, height;      // px
  double fx, fy, cx, cy;  // px; orthographic: fx and fy in px/m
  bool orthographic = false;
  std::vector<float> lens = {}, share = {};  // as in Frame, share as its vignette; empty: none
  double near = 0;                           // as in Frame
  bool near_sphere = false;
};

struct Sampling {
  std::vector<float> x, y;            // (samples) positions in the pixel, 0 ... 1
  std::vector<float> edge_x, edge_y;  // as in Frame
  std::vector<float> lens, share;
  std::vector<RayCone> primary;  // (rows, columns) of packets
  std::vector<RayCone> pairs;  // (rows, columns / 2) of packets side by side; none if orthographic
  int rows, columns;
};

// Fixed sample positions in a pixel, 0 ... 1. Out: x, y (count) each.
void sample_points(int count, std::vector<float>& x, std::vector<float>& y);

// The largest number of texture probes for each of so many samples a pixel; all of them together
// lie as densely as those of one sample.
int probes_of(int samples);

// Let a pinhole's samples blend outlines over their cells: the frame's cells.
void set_cells(int samples, Frame& frame);

// Let a pixel of PACKET samples find what covers it by more rays.
void set_edge_rays(Sampling& sampling, Frame& frame);

// Out: the sampling, and the camera's part of `frame`, which points into it.
void set_optics(const Optics& optics, int samples, Sampling& sampling, Frame& frame);

}  // namespace evs
