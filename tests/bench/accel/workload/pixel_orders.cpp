#include "tests/bench/accel/workload/pixel_orders.h"

namespace tessera::render::bench {

std::vector<contract::GridPoint> scanline_order(int side) {
  std::vector<contract::GridPoint> order;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) order.push_back({x, y});
  }
  return order;
}

std::vector<contract::GridPoint> morton_order(int side) {
  std::vector<contract::GridPoint> order;
  for (int i = 0; i < side * side; ++i) {
    contract::GridPoint at{0, 0};
    for (int bit = 0; (1 << bit) < side; ++bit) {
      at.x |= (i >> (2 * bit) & 1) << bit;
      at.y |= (i >> (2 * bit + 1) & 1) << bit;
    }
    order.push_back(at);
  }
  return order;
}

}  // namespace tessera::render::bench
