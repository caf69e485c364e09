#include "bvh.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

constexpr int BINS = 16, LEAF = 4, MAX_DEPTH = 60;

struct Box {
  float low[3] = {1e30f, 1e30f, 1e30f}, high[3] = {-1e30f, -1e30f, -1e30f};

  void add(const Box& b) {
    for (int a = 0; a < 3; a++) {
      low[a] = std::min(low[a], b.low[a]);
      high[a] = std::max(high[a], b.high[a]);
    }
  }
  float area() const {
    float x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
    return x < 0 ? 0.0f : x * y + y * z + z * x;
  }
};

struct Builder {
  const std::vector<Box>& boxes;
  const std::vector<V3>& centers;
  std::vector<int>& order;
  std::vector<Node>& nodes;
  float margin;  // around every box: what a hit on a triangle's rim may be off by

  static float axis(const V3& v, int a) { return a == 0 ? v.x : a == 1 ? v.y : v.z; }

  // Where to cut [begin, end): the cheapest of BINS - 1 planes on each axis, else the middle.
  int split(int begin, int end, int depth) {
    int middle = (begin + end) / 2;
    if (depth > MAX_DEPTH / 2)
      return halve(begin, end);  // a degenerate pile: keep the depth bounded
    float best = 1e30f, low = 0, scale = 0;
    int best_axis = -1, best_bin = 0;
    for (int a = 0; a < 3; a++) {
      float first = 1e30f, last = -1e30f;
      for (int i = begin; i < end; i++) {
        first = std::min(first, axis(centers[order[i]], a));
        last = std::max(last, axis(centers[order[i]], a));
      }
      float k = BINS * 0.9999f / (last - first);
      // all in one place, or so close together or far apart that floats cannot tell bins
      if (!(last - first > 0 && k > 0 && std::isfinite(k))) continue;
      Box bin[BINS];
      int count[BINS] = {};
      for (int i = begin; i < end; i++) {
        int b = static_cast<int>((axis(centers[order[i]], a) - first) * k);
        bin[b].add(boxes[order[i]]);
        count[b]++;
      }
      float right_cost[BINS];
      Box right, left;
      int on_right = 0, on_left = 0;
      for (int b = BINS - 1; b > 0; b--) {
        right.add(bin[b]);
        on_right += count[b];
        right_cost[b] = right.area() * static_cast<float>(on_right);
      }
      for (int b = 0; b + 1 < BINS; b++) {
        left.add(bin[b]);
        on_left += count[b];
        if (on_left == 0 || on_left == end - begin) continue;
        float cost = left.area() * static_cast<float>(on_left) + right_cost[b + 1];
        if (cost < best) best = cost, best_axis = a, best_bin = b, low = first, scale = k;
      }
    }
    if (best_axis < 0) return middle;
    auto cut = std::partition(order.begin() + begin, order.begin() + end, [&](int i) {
      return static_cast<int>((axis(centers[i], best_axis) - low) * scale) <= best_bin;
    });
    return static_cast<int>(cut - order.begin());
  }

  int halve(int begin, int end) {
    int middle = (begin + end) / 2;
    std::nth_element(
        order.begin() + begin, order.begin() + middle, order.begin() + end, [&](int i, int j) {
          return centers[i].x < centers[j].x || (centers[i].x == centers[j].x && i < j);
        });
    return middle;
  }

  // Fill child c of node n with [begin, end).
  void child(int n, int c, int begin, int end, int depth) {
    Box box;
    for (int i = begin; i < end; i++) box.add(boxes[order[i]]);
    for (int a = 0; a < 3; a++) {
      nodes[n].low[c][a] = box.low[a] - margin;
      nodes[n].high[c][a] = box.high[a] + margin;
    }
    nodes[n].count[c] = end - begin;
    if (end - begin <= LEAF) {
      nodes[n].child[c] = ~begin;
      return;
    }
    int below = static_cast<int>(nodes.size());
    nodes[n].child[c] = below;
    nodes.emplace_back();
    divide(below, begin, end, depth + 1);
  }

  void divide(int n, int begin, int end, int depth) {
    int middle = end - begin > 1 ? split(begin, end, depth) : end;
    child(n, 0, begin, middle, depth);
    child(n, 1, middle, end, depth);
  }
};

V3 minus(V3 a, V3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }

}  // namespace

Triangle make_triangle(V3 a, V3 b, V3 c) {
  V3 p = minus(b, a), q = minus(c, a);
  return {a, b, c, {p.y * q.z - p.z * q.y, p.z * q.x - p.x * q.z, p.x * q.y - p.y * q.x}};
}

Tree build_tree(const float* vertices, int vertex_count, const int32_t* faces, int face_count) {
  Tree tree;
  if (face_count == 0) return tree;
  auto vertex = [&](int i) {
    return V3{vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]};
  };
  std::vector<Box> boxes(face_count);
  std::vector<V3> centers(face_count);
  Box all;
  for (int f = 0; f < face_count; f++) {
    for (int k = 0; k < 3; k++) {
      V3 v = vertex(faces[3 * f + k]);
      Box point;
      point.low[0] = point.high[0] = v.x;
      point.low[1] = point.high[1] = v.y;
      point.low[2] = point.high[2] = v.z;
      boxes[f].add(point);
    }
    const Box& b = boxes[f];
    centers[f] = {0.5f * (b.low[0] + b.high[0]), 0.5f * (b.low[1] + b.high[1]),
                  0.5f * (b.low[2] + b.high[2])};
    all.add(b);
  }
  tree.center = {0.5f * (all.low[0] + all.high[0]), 0.5f * (all.low[1] + all.high[1]),
                 0.5f * (all.low[2] + all.high[2])};
  for (int i = 0; i < vertex_count; i++) {
    V3 v = minus(vertex(i), tree.center);
    tree.radius = std::max(tree.radius, std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z));
  }

  tree.order.resize(face_count);
  for (int f = 0; f < face_count; f++) tree.order[f] = f;
  tree.nodes.reserve(face_count);
  tree.nodes.emplace_back();
  Builder{boxes, centers, tree.order, tree.nodes, BOX_MARGIN * tree.radius}.divide(0, 0, face_count,
                                                                                   0);

  tree.triangles.reserve(face_count);
  for (int f : tree.order) {
    tree.triangles.push_back(
        make_triangle(vertex(faces[3 * f]), vertex(faces[3 * f + 1]), vertex(faces[3 * f + 2])));
  }
  return tree;
}

}  // namespace evs
