#include "worker/gltf/extensions/shape_reader.h"

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "worker/geometry/shapes/make_shape.h"

namespace tessera::render {
namespace {

constexpr double kLargest = 1e18, kSmallest = 1e-18;
/// Of blobs: beyond these, rounding would show.
constexpr double kStrongest = 1e6, kWeakest = 1e-6;
constexpr std::size_t kMaxBlobs = 10'000;

/// Numbers, `fallback` by default, each in [low, high].
Vec3d read_vector(const JsonView& look, std::string_view key, const std::vector<double>& fallback,
                  double low, double high, JsonFault& fault) {
  const std::vector<double> values = look.numbers(key, fallback);
  Vec3d out;
  for (std::size_t k = 0; k < fallback.size(); ++k) {
    if (!(values[k] >= low && values[k] <= high)) {
      fault.report(absl::StrCat(look.path(), ".", std::string(key), "[", k, "]"),
                   absl::StrCat(values[k], " is not in [", low, ", ", high, "]"));
    }
    out[static_cast<int>(k)] = values[k];
  }
  return out;
}

/// Reads dimensions; faults go to the element.
class ShapeReader {
 public:
  ShapeReader(const JsonView& look, JsonFault& fault) : look_(look), fault_(fault) {}

  Shape read() {
    const std::string type = look_.text("type");
    if (type == "sphere") {
      look_.allow({"type", "material", "radius"});
      const double r = dimension("radius", 1);
      return make_ellipsoid({r, r, r});
    }
    if (type == "ellipsoid") {
      look_.allow({"type", "material", "radii"});
      return make_ellipsoid(dimensions("radii", 3));
    }
    if (type == "disc") {
      look_.allow({"type", "material", "radius"});
      return make_disc(dimension("radius", 1));
    }
    if (type == "rectangle") {
      look_.allow({"type", "material", "size"});
      const Vec3d size = dimensions("size", 2);
      return make_rectangle(size.x, size.y);
    }
    if (type == "box") {
      look_.allow({"type", "material", "size"});
      return make_box(dimensions("size", 3));
    }
    if (type == "torus") return read_torus();
    if (type == "quadric") return read_quadric();
    return read_round(type);
  }

 private:
  double dimension(std::string_view key, double fallback) {
    return look_.number(key, fallback, kSmallest, kLargest);
  }

  /// `count` numbers, 1 by default; the rest 0.
  Vec3d dimensions(std::string_view key, std::size_t count) {
    return read_vector(look_, key, std::vector<double>(count, 1), kSmallest, kLargest, fault_);
  }

  /// Those about the y axis with a height.
  Shape read_round(const std::string& type) {
    const bool capped = look_.boolean("capped", true);
    const double radius = dimension("radius", 1), height = dimension("height", 2);
    if (type == "cylinder" || type == "cone" || type == "paraboloid") {
      look_.allow({"type", "material", "radius", "height", "capped"});
      return type == "cylinder" ? make_cylinder(radius, height, capped)
             : type == "cone"   ? make_cone(radius, height, capped)
                                : make_paraboloid(radius, height, capped);
    }
    if (type == "hyperboloid") {
      look_.allow({"type", "material", "waist", "radius", "height", "capped"});
      const double waist = dimension("waist", 0.5);
      if (!(waist < radius)) fault_.report(look_.path() + ".waist", "must be below the radius");
      return make_one_sheet_hyperboloid(waist, radius, height, capped);
    }
    if (type == "two-sheet-hyperboloid") {
      look_.allow({"type", "material", "gap", "radius", "height", "capped"});
      const double gap = dimension("gap", 0.5);
      if (!(gap < height)) fault_.report(look_.path() + ".gap", "must be below the height");
      return make_two_sheet_hyperboloid(gap, radius, height, capped);
    }
    fault_.report(look_.path() + ".type",
                  absl::StrCat("\"", type,
                               "\" is none of sphere, ellipsoid, disc, rectangle, box, cylinder, "
                               "cone, paraboloid, hyperboloid, two-sheet-hyperboloid, quadric, "
                               "torus"));
    return {};
  }

  Shape read_torus() {
    look_.allow({"type", "material", "radius", "tube"});
    const double radius = dimension("radius", 1), tube = dimension("tube", 0.25);
    if (!(tube < radius)) fault_.report(look_.path() + ".tube", "must be below the radius");
    return make_torus(radius, tube);
  }

  Shape read_quadric() {
    look_.allow({"type", "material", "coefficients", "min", "max", "capped"});
    // xx, yy, zz, yz, zx, xy, x, y, z, 1: each product of two different ones counts once.
    const std::vector<double> q = look_.numbers("coefficients", {1, 1, 1, 0, 0, 0, 0, 0, 0, -1});
    Quadric quadric;
    quadric.squares = {q[0], q[1], q[2]};
    quadric.products = Vec3d{q[3], q[4], q[5]} * 0.5;
    quadric.linear = Vec3d{q[6], q[7], q[8]} * 0.5;
    quadric.constant = q[9];
    Box3d clip;
    const std::vector<double> lo = look_.numbers("min", {-1, -1, -1});
    const std::vector<double> hi = look_.numbers("max", {1, 1, 1});
    for (int k = 0; k < 3; ++k) {
      clip.lo[k] = lo[static_cast<std::size_t>(k)];
      clip.hi[k] = hi[static_cast<std::size_t>(k)];
      if (!(clip.lo[k] < clip.hi[k] && clip.hi[k] - clip.lo[k] >= kSmallest)) {
        fault_.report(look_.path() + ".max", "must be above min in every axis");
      }
      if (!(clip.lo[k] >= -kLargest && clip.hi[k] <= kLargest)) {
        fault_.report(look_.path() + ".min", absl::StrCat("lies beyond ", kLargest));
      }
    }
    for (const double c : q) {
      if (!(c >= -kLargest && c <= kLargest)) {
        fault_.report(look_.path() + ".coefficients", absl::StrCat(c, " is too large"));
      }
    }
    return make_quadric(quadric, clip, look_.boolean("capped", true));
  }

  const JsonView& look_;
  JsonFault& fault_;
};

Blob read_blob(const JsonView& look, JsonFault& fault) {
  look.allow({"center", "radius", "radii", "strength"});
  if (look["radius"].present() && look["radii"].present()) {
    fault.report(look.path() + ".radii", "there is a radius already");
  }
  Blob blob;
  blob.centre = read_vector(look, "center", {0, 0, 0}, -kLargest, kLargest, fault);
  const double radius = look.number("radius", 1, kSmallest, kLargest);
  blob.radii = read_vector(look, "radii", {radius, radius, radius}, kSmallest, kLargest, fault);
  blob.strength = look.number("strength", 1, -kStrongest, kStrongest);
  return blob;
}

}  // namespace

std::shared_ptr<const Shape> read_shape(const JsonView& look, JsonFault& fault) {
  Shape shape = ShapeReader(look, fault).read();
  if (!fault.status().ok()) return nullptr;
  return std::make_shared<const Shape>(std::move(shape));
}

std::shared_ptr<const Shape> read_blobs(const JsonView& look, JsonFault& fault) {
  look.allow({"elements", "threshold", "material"});
  const double threshold = look.number("threshold", 0.25, kWeakest, kStrongest);
  const std::vector<JsonView> elements = look["elements"].items();
  if (elements.empty() || elements.size() > kMaxBlobs) {
    fault.report(look.path() + ".elements", absl::StrCat("must be 1 to ", kMaxBlobs, " blobs"));
    return nullptr;
  }
  std::vector<Blob> blobs;
  blobs.reserve(elements.size());
  for (const JsonView& element : elements) blobs.push_back(read_blob(element, fault));
  if (!fault.status().ok()) return nullptr;
  return std::make_shared<const Shape>(make_blobs(std::move(blobs), threshold));
}

std::optional<CsgOperation> read_csg(const JsonView& look, JsonFault& fault) {
  if (!look.present()) return std::nullopt;
  look.allow({"operation"});
  const std::string name = look.text("operation");
  if (name == "union") return CsgOperation::unite;
  if (name == "intersection") return CsgOperation::intersect;
  if (name == "subtraction") return CsgOperation::subtract;
  if (name == "xor") return CsgOperation::exclude;
  fault.report(look.path() + ".operation",
               absl::StrCat("\"", name, "\" is none of union, intersection, subtraction, xor"));
  return std::nullopt;
}

}  // namespace tessera::render
