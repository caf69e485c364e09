#include "render/geometry/geom_bvh.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

constexpr int WIDTH = GeomBvh::WIDTH;
constexpr double GROWTH = 1.5;       // of the groups, until they are formed anew
constexpr float EVERYWHERE = 1e18f;  // half extents; squares are finite

int groups_of(int count) { return (count + WIDTH - 1) / WIDTH; }

}  // namespace

float GeomBvhBuilder::Box::diameter() const { return 2 * std::hypot(half[0], half[1], half[2]); }

GeomBvhBuilder::GeomBvhBuilder(int first, int count) : first_(first), count_(count) {
  if (first + count > GeomBvh::MAX_GEOMS) return;
  geoms_.resize(static_cast<size_t>(count_));
  for (int i = 0; i < count_; i++) geoms_[static_cast<size_t>(i)] = first_ + i;
  entries_.resize(geoms_.size());
  int size = count_;
  for (int level = 0; level < GeomBvh::LEVELS; level++) {
    boxes_[level].resize(static_cast<size_t>(size));
    size = groups_of(size);
    size_t padded = static_cast<size_t>(size) * WIDTH;
    for (std::vector<float>& array : arrays_[level]) array.assign(padded, -1.0f);
  }
}

GeomBvh GeomBvhBuilder::view() const {
  GeomBvh out = {};
  if (geoms_.empty()) return out;
  for (int level = 0; level < GeomBvh::LEVELS; level++) {
    const std::vector<float>* a = arrays_[level];
    out.boxes[level] = {a[0].data(), a[1].data(), a[2].data(),
                        a[3].data(), a[4].data(), a[5].data()};
  }
  out.geoms = geoms_.data();
  out.top = static_cast<int>(boxes_[GeomBvh::LEVELS - 1].size());
  out.fine = fine_;
  return out;
}

void GeomBvhBuilder::update(const Geom* geoms, const Mesh* meshes) {
  if (geoms_.empty()) return;
  double size = refit(geoms, meshes);
  if (sorted_size_ >= 0 && size <= GROWTH * sorted_size_) return;
  sort();
  sorted_size_ = refit(geoms, meshes);
}

// Return a box around a geom; around everything, if its pose or its size is not finite.
GeomBvhBuilder::Box GeomBvhBuilder::box_of(const Geom& g, const Mesh* meshes) {
  const float *s = g.size, *m = g.rotation;
  float local[3] = {0, 0, 0}, half[3] = {s[0], s[1], s[2]}, round = 0;
  switch (g.shape) {
    case SPHERE:
    case CAPSULE:
      round = s[0];
      half[0] = half[1] = 0;
      half[2] = g.shape == CAPSULE ? s[1] : 0;
      break;
    case CYLINDER:
      half[1] = s[0];
      half[2] = s[1];
      break;
    case MESH:
    case HFIELD: {
      const Mesh& mesh = meshes[g.mesh];
      if (mesh.node_count == 0) return {{0, 0, 0}, {-1, -1, -1}};
      const Node& n = mesh.nodes[0];
      for (int a = 0; a < 3; a++) {
        float low = std::min(n.low[0][a], n.low[1][a]), high = std::max(n.high[0][a], n.high[1][a]);
        local[a] = 0.5f * (low + high);
        half[a] = 0.5f * (high - low);
      }
      break;
    }
    default:
      break;
  }
  Box box;
  const float position[3] = {g.position.x, g.position.y, g.position.z};
  float away = std::abs(position[0]) + std::abs(position[1]) + std::abs(position[2]);
  for (int i = 0; i < 3; i++) {
    const float* row = m + 3 * i;
    float reach = round, offset = 0, size = 0;
    for (int a = 0; a < 3; a++) {
      reach += std::abs(row[a]) * half[a];
      offset += row[a] * local[a];
      size += std::abs(local[a]) + half[a];
    }
    box.center[i] = position[i] + offset;
    // add the rounding of the position
    box.half[i] = reach * 1.0001f + size * 2e-5f + away * 5e-7f;
    if (!(std::abs(box.center[i]) + box.half[i] < EVERYWHERE)) {
      return {{0, 0, 0}, {EVERYWHERE, EVERYWHERE, EVERYWHERE}};
    }
  }
  return box;
}

GeomBvhBuilder::Box GeomBvhBuilder::box_around(const Box* boxes, int count) {
  Box out = {{0, 0, 0}, {-1, -1, -1}};
  float low[3] = {EVERYWHERE, EVERYWHERE, EVERYWHERE},
        high[3] = {-EVERYWHERE, -EVERYWHERE, -EVERYWHERE};
  for (int i = 0; i < count; i++) {
    if (boxes[i].half[0] < 0) continue;
    for (int a = 0; a < 3; a++) {
      low[a] = std::min(low[a], boxes[i].center[a] - boxes[i].half[a]);
      high[a] = std::max(high[a], boxes[i].center[a] + boxes[i].half[a]);
    }
  }
  for (int a = 0; a < 3 && low[a] <= high[a]; a++) {
    out.center[a] = 0.5f * (low[a] + high[a]);
    // add the rounding of these sums
    out.half[a] = 0.50001f * (high[a] - low[a]) + (std::abs(low[a]) + std::abs(high[a])) * 1e-6f;
  }
  return out;
}

// Bound every geom and every group. Out: the sum of the diameters of level 1.
double GeomBvhBuilder::refit(const Geom* geoms, const Mesh* meshes) {
  double size = 0;
  for (int level = 0; level < GeomBvh::LEVELS; level++) {
    int count = static_cast<int>(boxes_[level].size());
    for (int i = 0; i < count; i++) {
      Box& box = boxes_[level][i];
      if (level == 0) {
        box = box_of(geoms[geoms_[i]], meshes);
      } else {
        int below = static_cast<int>(boxes_[level - 1].size());
        box = box_around(&boxes_[level - 1][i * WIDTH], std::min(WIDTH, below - i * WIDTH));
      }
      for (int a = 0; a < 3; a++) {
        arrays_[level][a][i] = box.center[a];
        arrays_[level][3 + a][i] = box.half[a];
      }
      if (level == 1) size += box.diameter();
    }
  }
  return size;
}

// Sort the geoms into compact groups, large geoms apart from small ones.
void GeomBvhBuilder::sort() {
  for (size_t i = 0; i < entries_.size(); i++) {
    const Box& box = boxes_[0][i];
    entries_[i] = {{box.center[0], box.center[1], box.center[2], box.diameter()}, geoms_[i]};
  }
  auto middle = entries_.begin() + count_ / 2;
  std::nth_element(entries_.begin(), middle, entries_.end(),
                   [](const Entry& a, const Entry& b) { return a.key[3] < b.key[3]; });
  fine_ = middle->key[3];
  split(0, count_);
  for (size_t i = 0; i < entries_.size(); i++) geoms_[i] = entries_[i].geom;
}

// Halve the entries where they are furthest apart, down to single groups.
void GeomBvhBuilder::split(int begin, int end) {
  int count = end - begin;
  if (count <= WIDTH) return;
  auto first = entries_.begin() + begin, last = entries_.begin() + end;
  int axis = 0;
  float widest = -1;
  for (int a = 0; a < 4; a++) {
    auto [low, high] = std::minmax_element(
        first, last, [a](const Entry& p, const Entry& q) { return p.key[a] < q.key[a]; });
    float extent = high->key[a] - low->key[a];
    if (extent > widest) widest = extent, axis = a;
  }
  // full groups, of the highest level that fits
  int unit = count > WIDTH * WIDTH ? WIDTH * WIDTH : WIDTH;
  int middle = (count / 2 + unit - 1) / unit * unit;
  std::nth_element(first, first + middle, last, [axis](const Entry& p, const Entry& q) {
    return p.key[axis] != q.key[axis] ? p.key[axis] < q.key[axis] : p.geom < q.geom;
  });
  split(begin, begin + middle);
  split(begin + middle, end);
}

}  // namespace evs
