#include "scene/bvh.h"

#include <algorithm>
#include <cmath>

namespace evs {
namespace {

constexpr int BINS = 16, LEAF = 6, MAX_DEPTH = 60;

// Boxes exceed their triangles by this share of the radius, the error of a hit on an edge.
constexpr float BOX_MARGIN = 2e-6f;

struct Box {
  float low[3] = {1e30f, 1e30f, 1e30f}, high[3] = {-1e30f, -1e30f, -1e30f};

  // a NaN leaves the box unchanged
  void add(V3 v) {
    const float at[3] = {v.x, v.y, v.z};
    for (int a = 0; a < 3; a++) {
      low[a] = std::min(low[a], at[a]);
      high[a] = std::max(high[a], at[a]);
    }
  }
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

  static float axis(const V3& v, int a) { return a == 0 ? v.x : a == 1 ? v.y : v.z; }

  // Split [begin, end) by the surface area heuristic: the cheapest of BINS - 1 planes on each axis,
  // else the middle.
  int split(int begin, int end, int depth) {
    int middle = (begin + end) / 2;
    if (depth > MAX_DEPTH / 2) return halve(begin, end);  // degenerate geometry: bound the depth
    float best = 1e30f, low = 0, scale = 0;
    int best_axis = -1, best_bin = 0;
    for (int a = 0; a < 3; a++) {
      float first = 1e30f, last = -1e30f;
      for (int i = begin; i < end; i++) {
        first = std::min(first, axis(centers[order[i]], a));
        last = std::max(last, axis(centers[order[i]], a));
      }
      float k = BINS * 0.9999f / (last - first);
      // centres too close together or too far apart for bins in floats
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

  // Fill child c of node n with [begin, end). Boxes are refitted later.
  void child(int n, int c, int begin, int end, int depth) {
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

V3 row(const float* rows, int i) { return {rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]}; }

Triangle make_triangle(V3 a, V3 b, V3 c) {
  V3 p = minus(b, a), q = minus(c, a);
  return {a, b, c, {p.y * q.z - p.z * q.y, p.z * q.x - p.x * q.z, p.x * q.y - p.y * q.x}};
}

// Bound all vertices by a sphere around the centre of the triangles' box.
void refit_sphere(Bvh& bvh, const float* vertices, int vertex_count) {
  Box all;
  for (const Triangle& t : bvh.triangles) {
    for (V3 v : {t.a, t.b, t.c}) all.add(v);
  }
  bvh.center = {0.5f * (all.low[0] + all.high[0]), 0.5f * (all.low[1] + all.high[1]),
                0.5f * (all.low[2] + all.high[2])};
  bvh.radius = 0;
  for (int i = 0; i < vertex_count; i++) {
    V3 v = minus(row(vertices, i), bvh.center);
    bvh.radius = std::max(bvh.radius, std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z));
  }
}

// Refit all boxes, last node first: children come after their parents.
void refit_boxes(Bvh& bvh) {
  float margin = BOX_MARGIN * bvh.radius;
  for (size_t n = bvh.nodes.size(); n-- > 0;) {
    Node& node = bvh.nodes[n];
    for (int c = 0; c < 2; c++) {
      Box box;
      if (node.child[c] >= 0) {
        const Node& below = bvh.nodes[node.child[c]];
        for (int k = 0; k < 2; k++) {
          box.add(V3{below.low[k][0], below.low[k][1], below.low[k][2]});
          box.add(V3{below.high[k][0], below.high[k][1], below.high[k][2]});
        }
      } else {
        for (int i = ~node.child[c], end = i + node.count[c]; i < end; i++) {
          const Triangle& t = bvh.triangles[i];
          for (V3 v : {t.a, t.b, t.c}) box.add(v);
        }
        for (int a = 0; a < 3; a++) {
          box.low[a] -= margin;
          box.high[a] += margin;
        }
      }
      std::copy(box.low, box.low + 3, node.low[c]);
      std::copy(box.high, box.high + 3, node.high[c]);
    }
  }
}

}  // namespace

void refit(Bvh& bvh, const float* vertices, int vertex_count) {
  bvh.triangles.resize(bvh.order.size());
  for (size_t i = 0; i < bvh.triangles.size(); i++) {
    const int32_t* face = &bvh.faces[3 * i];
    bvh.triangles[i] =
        make_triangle(row(vertices, face[0]), row(vertices, face[1]), row(vertices, face[2]));
  }
  refit_sphere(bvh, vertices, vertex_count);
  refit_boxes(bvh);
}

Bvh build_bvh(const float* vertices, int vertex_count, const int32_t* faces, int face_count) {
  Bvh bvh;
  if (face_count == 0) return bvh;
  std::vector<Box> boxes(face_count);
  std::vector<V3> centers(face_count);
  for (int f = 0; f < face_count; f++) {
    for (int k = 0; k < 3; k++) boxes[f].add(row(vertices, faces[3 * f + k]));
    const Box& b = boxes[f];
    centers[f] = {0.5f * (b.low[0] + b.high[0]), 0.5f * (b.low[1] + b.high[1]),
                  0.5f * (b.low[2] + b.high[2])};
  }
  bvh.order.resize(face_count);
  for (int f = 0; f < face_count; f++) bvh.order[f] = f;
  bvh.nodes.reserve(face_count);
  bvh.nodes.emplace_back();
  Builder{boxes, centers, bvh.order, bvh.nodes}.divide(0, 0, face_count, 0);
  for (int f : bvh.order) bvh.faces.insert(bvh.faces.end(), faces + 3 * f, faces + 3 * f + 3);
  refit(bvh, vertices, vertex_count);
  return bvh;
}

}  // namespace evs
