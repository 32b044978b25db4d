// No structure: visits every shape. The tests compare the other structures with it.

#include "worker/accelerators/structures.h"

namespace tessera::render::accelerators {
namespace {

class BruteForce final : public ShapeIndex {
 public:
  explicit BruteForce(std::uint32_t size) : size_(size) {}

  bool traverse(const ShapeRay&, const float&, const ShapeVisitor& visit,
                TraversalStats&) const override {
    for (std::uint32_t shape = 0; shape < size_; ++shape) {
      if (visit(shape)) return true;
    }
    return false;
  }
  std::size_t memory_bytes() const override { return 0; }

 private:
  std::uint32_t size_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_brute_force(const ShapeBounds& shapes) {
  return std::make_unique<BruteForce>(shapes.size());
}

}  // namespace tessera::render::accelerators
