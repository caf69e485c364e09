// The hierarchy over many geoms: boxes around 16 geoms each, and around 16 of those each. The
// kernels walk it to find the geoms that rays may touch.
#pragma once

#include <cstddef>
#include <vector>

#include "scene/scene.h"

namespace evs {

class GeomBvhBuilder {
 public:
  // In: geoms `first` ... `first` + `count` - 1, none of them a plane.
  GeomBvhBuilder(int first, int count);

  // Bound the geoms where they are now. In: all geoms, and the meshes.
  void update(const Geom* geoms, const Mesh* meshes);
  // Return the hierarchy of the last update; none over no geoms, or more than kernels can collect.
  GeomBvh view() const;
  // The length of the arrays in `view`: of boxes by level, and of geoms.
  size_t boxes(int level) const { return arrays_[level][0].size(); }
  size_t geoms() const { return geoms_.size(); }

 private:
  struct Box {
    float center[3], half[3];
    float diameter() const;
  };
  struct Entry {
    float key[4];  // center and diameter
    int geom;
  };

  static Box box_of(const Geom& geom, const Mesh* meshes);
  static Box box_around(const Box* boxes, int count);
  double refit(const Geom* geoms, const Mesh* meshes);
  void sort();
  void split(int begin, int end);

  int first_, count_;
  std::vector<int32_t> geoms_;  // by box of level 0
  std::vector<Entry> entries_;  // while they are sorted
  std::vector<Box> boxes_[GeomBvh::LEVELS];
  std::vector<float> arrays_[GeomBvh::LEVELS][6];
  float fine_ = 0;           // median diameter of the geoms when last sorted
  double sorted_size_ = -1;  // sum of the diameters of level 1 then
};

}  // namespace evs
