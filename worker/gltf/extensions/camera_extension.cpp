#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/gltf/extensions/extension_reader.h"
#include "worker/gltf/file/json_view.h"
#include "worker/math/elementary.h"

namespace tessera::render {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kMaxLength = 1e18;  // metres
constexpr double kMinLength = 1e-12;
constexpr std::int64_t kMaxBlades = 64;

Vec3d vec3(const JsonView& from, const char* key, const Vec3d& fallback, JsonFault& fault) {
  const std::vector<double> v = from.numbers(key, {fallback.x, fallback.y, fallback.z});
  const Vec3d out{v[0], v[1], v[2]};
  if (!(max_abs(out) <= kMaxLength)) fault.report(from[key].path(), "is too large");
  return out;
}

void require(const JsonView& from, std::initializer_list<const char*> keys, JsonFault& fault) {
  for (const char* key : keys) {
    if (!from[key].present()) fault.report(from.path(), absl::StrCat("has no ", key));
  }
}

/// Reads one camera's extension (docs/reference/extensions/TESSERA_camera.md).
class CameraReader {
 public:
  CameraReader(const JsonView& object, const GltfModel& model, JsonFault& fault, GltfCamera& out)
      : object_(object), model_(model), fault_(fault), out_(out), camera_(out.camera) {}

  void read() {
    object_.allow({"projection", "horizontalAngle", "verticalAngle", "angle", "frustum",
                   "direction", "lookAt", "lens", "shutter"});
    read_projection();
    read_frustum(object_["frustum"]);
    read_direction();
    read_look_at(object_["lookAt"]);
    read_lens(object_["lens"]);
    read_shutter(object_["shutter"]);
  }

 private:
  bool is_curved() const {
    return camera_.kind != Camera::Kind::perspective && camera_.kind != Camera::Kind::orthographic;
  }

  /// Reports a fault for each of `keys` that is present.
  void reject(std::initializer_list<const char*> keys, const char* reason) {
    for (const char* key : keys) {
      if (object_[key].present()) fault_.report(object_[key].path(), reason);
    }
  }

  double angle(const char* key, double fallback, double max) {
    const double value = object_.number(key, fallback, 0, max);
    if (!(value > 0)) fault_.report(object_[key].path(), "must be above 0");
    return value;
  }

  void read_projection() {
    const std::string name = object_.text("projection");
    if (!object_["projection"].present()) {
      reject({"horizontalAngle", "verticalAngle", "angle"}, "not allowed without a projection");
    } else if (name == "spherical" || name == "cylindrical") {
      const bool sphere = name == "spherical";
      camera_.kind = sphere ? Camera::Kind::spherical : Camera::Kind::cylindrical;
      camera_.horizontal_angle = angle("horizontalAngle", 2 * kPi, 2 * kPi);
      // The height of a cylinder tends to infinity towards pi.
      camera_.vertical_angle =
          sphere ? angle("verticalAngle", kPi, kPi) : angle("verticalAngle", kPi / 2, 3.1);
      reject({"angle"}, "allowed only with an equidistant or equisolid projection");
    } else if (name == "equidistant" || name == "equisolid") {
      camera_.kind = name == "equidistant" ? Camera::Kind::equidistant : Camera::Kind::equisolid;
      camera_.horizontal_angle = camera_.vertical_angle = angle("angle", kPi, 2 * kPi);
      reject({"horizontalAngle", "verticalAngle"},
             "allowed only with a spherical or cylindrical projection");
    } else {
      fault_.report(object_.path() + ".projection",
                    "is not spherical, cylindrical, equidistant or equisolid");
    }
    if (is_curved())
      reject({"frustum", "direction", "lens"}, "not allowed with a curved projection");
  }

  /// An arbitrary window on the near plane, as in OpenGL's glFrustum and glOrtho.
  void read_frustum(const JsonView& frustum) {
    if (!frustum.present()) return;
    frustum.allow({"left", "right", "bottom", "top", "near", "far"});
    require(frustum, {"left", "right", "bottom", "top", "near"}, fault_);
    const bool flat = camera_.kind == Camera::Kind::orthographic;
    const auto side = [&](const char* key) {
      return frustum.number(key, 0, -kMaxLength, kMaxLength);
    };
    const double left = side("left"), right = side("right");
    const double bottom = side("bottom"), top = side("top");
    const double near = frustum.number("near", 1, flat ? 0 : kMinLength, kMaxLength);
    camera_.znear = near;
    camera_.zfar = INFINITY;
    if (frustum["far"].present()) camera_.zfar = frustum.number("far", 1, 0, kMaxLength);
    if (!(left < right)) fault_.report(frustum.path(), "left is not below right");
    if (!(bottom < top)) fault_.report(frustum.path(), "bottom is not below top");
    if (!(near < camera_.zfar)) fault_.report(frustum.path(), "near is not below far");
    const double scale = flat ? 1 : near;
    camera_.center_x = 0.5 * (left + right) / scale;
    camera_.center_y = 0.5 * (bottom + top) / scale;
    const double half_height = 0.5 * (top - bottom) / scale;
    camera_.ymag = half_height;
    camera_.yfov = 2 * elementary::atan2(half_height, 1.0);
  }

  void read_direction() {
    if (!object_["direction"].present()) return;
    if (camera_.kind == Camera::Kind::perspective) {
      reject({"direction"}, "not allowed on a perspective camera");
    }
    const Vec3d d = vec3(object_, "direction", {0, 0, -1}, fault_);
    if (!(d.z < 0))
      return fault_.report(object_["direction"].path(), "must point forwards (z < 0)");
    camera_.slant_x = d.x / -d.z;
    camera_.slant_y = d.y / -d.z;
    if (!(std::fabs(camera_.slant_x) <= 1e6 && std::fabs(camera_.slant_y) <= 1e6)) {
      fault_.report(object_["direction"].path(), "is parallel to the image plane");
    }
  }

  void read_look_at(const JsonView& look_at) {
    if (!look_at.present()) return;
    look_at.allow({"position", "target", "up"});
    require(look_at, {"position", "target"}, fault_);
    LookAt out;
    out.position = vec3(look_at, "position", out.position, fault_);
    out.target = vec3(look_at, "target", {0, 0, -1}, fault_);
    out.up = vec3(look_at, "up", out.up, fault_);
    out_.look_at = out;
  }

  void read_lens(const JsonView& lens) {
    if (!lens.present()) return;
    lens.allow({"fNumber", "sensorHeight", "focusDistance", "focusNode", "blades", "bladeRotation",
                "rim"});
    require(lens, {"fNumber"}, fault_);
    if (camera_.kind == Camera::Kind::orthographic) {
      fault_.report(lens.path(), "needs a perspective camera");
    }
    out_.f_number = lens.number("fNumber", 1, 1e-6, 1e12);
    out_.sensor_height = lens.number("sensorHeight", out_.sensor_height, kMinLength, kMaxLength);
    if (lens["focusDistance"].present() == lens["focusNode"].present()) {
      fault_.report(lens.path(), "must have either focusDistance or focusNode");
    }
    out_.focus_node = lens.index("focusNode", model_.nodes.size());
    Lens& l = camera_.lens;
    l.focus_distance = lens.number("focusDistance", 1, kMinLength, kMaxLength);
    const std::int64_t blades = lens.integer("blades", kMaxBlades + 1);
    l.blades = blades < 0 ? 0 : static_cast<std::int32_t>(blades);
    if (l.blades == 1 || l.blades == 2)
      fault_.report(lens.path() + ".blades", "must be 0 or 3 to 64");
    l.blade_rotation = lens.number("bladeRotation", 0, -1e6, 1e6);
    const JsonView rim = lens["rim"];
    if (!rim.present()) return;
    rim.allow({"distance", "radius"});
    require(rim, {"distance", "radius"}, fault_);
    l.rim_distance = rim.number("distance", 1, kMinLength, kMaxLength);
    l.rim_radius = rim.number("radius", 1, kMinLength, kMaxLength);
  }

  void read_shutter(const JsonView& shutter) {
    if (!shutter.present()) return;
    shutter.allow({"open", "close"});
    require(shutter, {"close"}, fault_);
    camera_.shutter_open = shutter.number("open", 0, -1e6, 1e6);
    camera_.shutter_close = shutter.number("close", 0, -1e6, 1e6);
    if (camera_.shutter_open > camera_.shutter_close) {
      fault_.report(shutter.path(), "open is after close");
    }
  }

  const JsonView& object_;
  const GltfModel& model_;
  JsonFault& fault_;
  GltfCamera& out_;
  Camera& camera_;
};

}  // namespace

absl::Status read_camera_extensions(const nlohmann::json& root, GltfModel& model) {
  JsonFault fault(model.faults);
  const std::vector<JsonView> cameras = JsonView(root, "", fault)["cameras"].items();
  for (std::size_t i = 0; i < cameras.size() && i < model.cameras.size(); ++i) {
    const JsonView object = cameras[i].extension("TESSERA_camera");
    if (object.present()) CameraReader(object, model, fault, model.cameras[i]).read();
  }
  return fault.status();
}

}  // namespace tessera::render
