#include "worker/gltf/extensions/shape_reader.h"

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "worker/geometry/shapes/make_shape.h"

namespace tessera::render {
namespace {

/// Limits of blobs; beyond them rounding errors become visible.
constexpr double kMaxStrength = 1e6, kMinStrength = 1e-6;
constexpr std::size_t kMaxBlobs = 10'000;

/// Numbers in [low, high], `fallback` if absent.
Vec3d read_vector(const JsonView& object, std::string_view key, const std::vector<double>& fallback,
                  double low, double high, JsonFault& fault) {
  const std::vector<double> values = object.numbers(key, fallback);
  Vec3d out;
  for (std::size_t k = 0; k < fallback.size(); ++k) {
    if (!(values[k] >= low && values[k] <= high)) {
      fault.report(absl::StrCat(object.path(), ".", std::string(key), "[", k, "]"),
                   absl::StrCat(values[k], " is not in [", low, ", ", high, "]"));
    }
    out[static_cast<int>(k)] = values[k];
  }
  return out;
}

/// Reads the dimensions of a shape and reports faults.
class ShapeReader {
 public:
  ShapeReader(const JsonView& object, JsonFault& fault) : object_(object), fault_(fault) {}

  Shape read() {
    const std::string type = object_.text("type");
    if (type == "sphere") {
      object_.allow({"type", "material", "radius"});
      const double r = dimension("radius", 1);
      return make_ellipsoid({r, r, r});
    }
    if (type == "ellipsoid") {
      object_.allow({"type", "material", "radii"});
      return make_ellipsoid(dimensions("radii", 3));
    }
    if (type == "disc") {
      object_.allow({"type", "material", "radius"});
      return make_disc(dimension("radius", 1));
    }
    if (type == "rectangle") {
      object_.allow({"type", "material", "size"});
      const Vec3d size = dimensions("size", 2);
      return make_rectangle(size.x, size.y);
    }
    if (type == "plane") {
      object_.allow({"type", "material"});
      return make_plane();
    }
    if (type == "box") {
      object_.allow({"type", "material", "size"});
      return make_box(dimensions("size", 3));
    }
    if (type == "torus") return read_torus();
    if (type == "quadric") return read_quadric();
    return read_revolution(type);
  }

 private:
  double dimension(std::string_view key, double fallback) {
    return object_.number(key, fallback, kMinShapeLength, kMaxShapeLength);
  }

  /// `count` numbers, 1 by default; further components are 0.
  Vec3d dimensions(std::string_view key, std::size_t count) {
    return read_vector(object_, key, std::vector<double>(count, 1), kMinShapeLength,
                       kMaxShapeLength, fault_);
  }

  /// Reads a surface of revolution about the y axis.
  Shape read_revolution(const std::string& type) {
    const bool capped = object_.boolean("capped", true);
    const double radius = dimension("radius", 1), height = dimension("height", 2);
    if (type == "cylinder" || type == "cone" || type == "paraboloid") {
      object_.allow({"type", "material", "radius", "height", "capped"});
      return type == "cylinder" ? make_cylinder(radius, height, capped)
             : type == "cone"   ? make_cone(radius, height, capped)
                                : make_paraboloid(radius, height, capped);
    }
    if (type == "hyperboloid") {
      object_.allow({"type", "material", "waist", "radius", "height", "capped"});
      const double waist = dimension("waist", 0.5);
      if (!(waist < radius)) fault_.report(object_.path() + ".waist", "must be below the radius");
      return make_one_sheet_hyperboloid(waist, radius, height, capped);
    }
    if (type == "two-sheet-hyperboloid") {
      object_.allow({"type", "material", "gap", "radius", "height", "capped"});
      const double gap = dimension("gap", 0.5);
      if (!(gap < height)) fault_.report(object_.path() + ".gap", "must be below the height");
      return make_two_sheet_hyperboloid(gap, radius, height, capped);
    }
    fault_.report(
        object_.path() + ".type",
        absl::StrCat("\"", type,
                     "\" is not one of sphere, ellipsoid, plane, disc, rectangle, box, "
                     "cylinder, cone, paraboloid, hyperboloid, two-sheet-hyperboloid, quadric, "
                     "torus"));
    return {};
  }

  Shape read_torus() {
    object_.allow({"type", "material", "radius", "tube"});
    const double radius = dimension("radius", 1), tube = dimension("tube", 0.25);
    if (!(tube < radius)) fault_.report(object_.path() + ".tube", "must be below the radius");
    return make_torus(radius, tube);
  }

  Shape read_quadric() {
    object_.allow({"type", "material", "coefficients", "min", "max", "capped"});
    // Order: xx, yy, zz, yz, zx, xy, x, y, z, 1; mixed products occur once.
    const std::vector<double> q = object_.numbers("coefficients", {1, 1, 1, 0, 0, 0, 0, 0, 0, -1});
    Quadric quadric;
    quadric.squares = {q[0], q[1], q[2]};
    quadric.products = Vec3d{q[3], q[4], q[5]} * 0.5;
    quadric.linear = Vec3d{q[6], q[7], q[8]} * 0.5;
    quadric.constant = q[9];
    Box3d clip;
    const std::vector<double> lo = object_.numbers("min", {-1, -1, -1});
    const std::vector<double> hi = object_.numbers("max", {1, 1, 1});
    for (int k = 0; k < 3; ++k) {
      clip.lo[k] = lo[static_cast<std::size_t>(k)];
      clip.hi[k] = hi[static_cast<std::size_t>(k)];
      if (!(clip.lo[k] < clip.hi[k] && clip.hi[k] - clip.lo[k] >= kMinShapeLength)) {
        fault_.report(object_.path() + ".max", "must be above min in every axis");
      }
      if (!(clip.lo[k] >= -kMaxShapeLength && clip.hi[k] <= kMaxShapeLength)) {
        fault_.report(object_.path() + ".min", absl::StrCat("lies beyond ", kMaxShapeLength));
      }
    }
    for (const double c : q) {
      if (!(c >= -kMaxShapeLength && c <= kMaxShapeLength)) {
        fault_.report(object_.path() + ".coefficients", absl::StrCat(c, " is too large"));
      }
    }
    return make_quadric(quadric, clip, object_.boolean("capped", true));
  }

  const JsonView& object_;
  JsonFault& fault_;
};

Blob read_blob(const JsonView& object, JsonFault& fault) {
  object.allow({"center", "radius", "radii", "strength"});
  if (object["radius"].present() && object["radii"].present()) {
    fault.report(object.path() + ".radii", "not allowed together with radius");
  }
  Blob blob;
  blob.centre = read_vector(object, "center", {0, 0, 0}, -kMaxShapeLength, kMaxShapeLength, fault);
  const double radius = object.number("radius", 1, kMinShapeLength, kMaxShapeLength);
  blob.radii = read_vector(object, "radii", {radius, radius, radius}, kMinShapeLength,
                           kMaxShapeLength, fault);
  blob.strength = object.number("strength", 1, -kMaxStrength, kMaxStrength);
  return blob;
}

}  // namespace

std::shared_ptr<const Shape> read_shape(const JsonView& object, JsonFault& fault) {
  Shape shape = ShapeReader(object, fault).read();
  if (!fault.status().ok()) return nullptr;
  return std::make_shared<const Shape>(std::move(shape));
}

std::shared_ptr<const Shape> read_blobs(const JsonView& object, JsonFault& fault) {
  object.allow({"elements", "threshold", "material"});
  const double threshold = object.number("threshold", 0.25, kMinStrength, kMaxStrength);
  const std::vector<JsonView> elements = object["elements"].items();
  if (elements.empty() || elements.size() > kMaxBlobs) {
    fault.report(object.path() + ".elements", absl::StrCat("must be 1 to ", kMaxBlobs, " blobs"));
    return nullptr;
  }
  std::vector<Blob> blobs;
  blobs.reserve(elements.size());
  for (const JsonView& element : elements) blobs.push_back(read_blob(element, fault));
  if (!fault.status().ok()) return nullptr;
  return std::make_shared<const Shape>(make_blobs(std::move(blobs), threshold));
}

std::optional<CsgOperation> read_csg(const JsonView& object, JsonFault& fault) {
  if (!object.present()) return std::nullopt;
  object.allow({"operation"});
  const std::string name = object.text("operation");
  if (name == "union") return CsgOperation::unite;
  if (name == "intersection") return CsgOperation::intersect;
  if (name == "subtraction") return CsgOperation::subtract;
  if (name == "xor") return CsgOperation::exclude;
  fault.report(object.path() + ".operation",
               absl::StrCat("\"", name, "\" is not one of union, intersection, subtraction, xor"));
  return std::nullopt;
}

}  // namespace tessera::render
