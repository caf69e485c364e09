#include "geometry/light_reach.h"

namespace evs {

LightReaches::LightReaches(size_t lights) {
  // the widest kernel reads 32 from any light on
  for (std::vector<float>& array : arrays_) array.assign(lights + 31, 0.0f);
}

void LightReaches::update(const std::vector<Light>& lights) {
  for (size_t i = 0; i < lights.size(); i++) {
    const V3 p = lights[i].position, d = lights[i].direction;
    LightReach reach = reach_of(lights[i]);
    const float values[9] = {p.x, p.y, p.z, d.x, d.y, d.z, reach.cosine, reach.sine, reach.fade};
    for (int k = 0; k < 9; k++) arrays_[k][i] = values[k];
  }
}

LightReachArray LightReaches::view() const {
  const std::vector<float>* a = arrays_;
  return {a[0].data(), a[1].data(), a[2].data(), a[3].data(), a[4].data(),
          a[5].data(), a[6].data(), a[7].data(), a[8].data()};
}

}  // namespace evs
