// Equal cells that the ray visits one after the other. Sources: A. Fujimoto, T. Tanaka, K. Iwata,
// "ARTS: accelerated ray-tracing system", 1986; and those of grid.h. The second structure is the
// same grid with mailboxes as first published.

#include <tbb/enumerable_thread_specific.h>

#include "worker/accelerators/grids/grid.h"
#include "worker/accelerators/grids/grids.h"

namespace tessera::render::accelerators {
namespace {

class UniformGridIndex final : public ShapeIndex {
 public:
  explicit UniformGridIndex(const ShapeBounds& shapes)
      : grid_(shapes.boxes, all_shapes(shapes.size())) {}

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    Mailbox mailbox;
    return grid_.traverse(ray, limit, visit, mailbox, stats);
  }
  std::size_t memory_bytes() const override { return grid_.memory_bytes(); }

 private:
  UniformGrid grid_;
};

class MailboxGridIndex final : public ShapeIndex {
 public:
  explicit MailboxGridIndex(const ShapeBounds& shapes)
      : grid_(shapes.boxes, all_shapes(shapes.size())), mailboxes_(RayMailboxes(shapes.size())) {}

  bool traverse(const ShapeRay& ray, const float& limit, const ShapeVisitor& visit,
                TraversalStats& stats) const override {
    RayMailboxes& mailboxes = mailboxes_.local();
    mailboxes.next_ray();
    return grid_.traverse(ray, limit, visit, mailboxes, stats);
  }
  std::size_t memory_bytes() const override {  // with the mailboxes of one thread
    return grid_.memory_bytes() + grid_.shapes().size() * sizeof(std::uint32_t);
  }

 private:
  UniformGrid grid_;
  mutable tbb::enumerable_thread_specific<RayMailboxes> mailboxes_;
};

}  // namespace

std::unique_ptr<ShapeIndex> build_mailbox_grid(const ShapeBounds& shapes) {
  return std::make_unique<MailboxGridIndex>(shapes);
}

std::unique_ptr<ShapeIndex> build_uniform_grid(const ShapeBounds& shapes) {
  return std::make_unique<UniformGridIndex>(shapes);
}

}  // namespace tessera::render::accelerators
