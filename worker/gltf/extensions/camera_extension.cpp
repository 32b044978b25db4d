#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/math/elementary.h"
#include "worker/gltf/extensions/extension_reader.h"
#include "worker/gltf/file/json_view.h"

namespace tessera::render {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kLargest = 1e18;  // metres
constexpr double kSmallest = 1e-12;
constexpr std::int64_t kMaxBlades = 64;

Vec3d vec3(const JsonView& from, const char* key, const Vec3d& fallback, JsonFault& fault) {
  const std::vector<double> v = from.numbers(key, {fallback.x, fallback.y, fallback.z});
  const Vec3d out{v[0], v[1], v[2]};
  if (!(max_abs(out) <= kLargest)) fault.report(from[key].path(), "is too large");
  return out;
}

void require(const JsonView& from, std::initializer_list<const char*> keys, JsonFault& fault) {
  for (const char* key : keys) {
    if (!from[key].present()) fault.report(from.path(), absl::StrCat("has no ", key));
  }
}

/// Reads one camera's extension (docs/extensions.md, TESSERA_camera).
class CameraReader {
 public:
  CameraReader(const JsonView& look, const GltfModel& document, JsonFault& fault, GltfCamera& out)
      : look_(look), document_(document), fault_(fault), out_(out), camera_(out.camera) {}

  void read() {
    look_.allow({"projection", "horizontalAngle", "verticalAngle", "angle", "frustum", "direction",
                 "lookAt", "lens", "shutter"});
    read_projection();
    read_frustum(look_["frustum"]);
    read_direction();
    read_look_at(look_["lookAt"]);
    read_lens(look_["lens"]);
    read_shutter(look_["shutter"]);
  }

 private:
  bool is_curved() const {
    return camera_.kind != Camera::Kind::perspective && camera_.kind != Camera::Kind::orthographic;
  }

  /// Members that mean nothing beside what the camera is.
  void refuse(std::initializer_list<const char*> keys, const char* reason) {
    for (const char* key : keys) {
      if (look_[key].present()) fault_.report(look_[key].path(), reason);
    }
  }

  double angle(const char* key, double fallback, double most) {
    const double value = look_.number(key, fallback, 0, most);
    if (!(value > 0)) fault_.report(look_[key].path(), "must be above 0");
    return value;
  }

  void read_projection() {
    const std::string name = look_.text("projection");
    if (!look_["projection"].present()) {
      refuse({"horizontalAngle", "verticalAngle", "angle"}, "means nothing without a projection");
    } else if (name == "spherical" || name == "cylindrical") {
      const bool sphere = name == "spherical";
      camera_.kind = sphere ? Camera::Kind::spherical : Camera::Kind::cylindrical;
      camera_.horizontal_angle = angle("horizontalAngle", 2 * kPi, 2 * kPi);
      // A cylinder would have to be infinitely high for half a turn.
      camera_.vertical_angle =
          sphere ? angle("verticalAngle", kPi, kPi) : angle("verticalAngle", kPi / 2, 3.1);
      refuse({"angle"}, "belongs to equidistant and equisolid");
    } else if (name == "equidistant" || name == "equisolid") {
      camera_.kind = name == "equidistant" ? Camera::Kind::equidistant : Camera::Kind::equisolid;
      camera_.horizontal_angle = camera_.vertical_angle = angle("angle", kPi, 2 * kPi);
      refuse({"horizontalAngle", "verticalAngle"}, "belongs to spherical and cylindrical");
    } else {
      fault_.report(look_.path() + ".projection",
                    "is not spherical, cylindrical, equidistant or equisolid");
    }
    if (is_curved()) refuse({"frustum", "direction", "lens"}, "means nothing on a curved screen");
  }

  /// Any window on the near plane, as OpenGL's glFrustum and glOrtho.
  void read_frustum(const JsonView& frustum) {
    if (!frustum.present()) return;
    frustum.allow({"left", "right", "bottom", "top", "near", "far"});
    require(frustum, {"left", "right", "bottom", "top", "near"}, fault_);
    const bool flat = camera_.kind == Camera::Kind::orthographic;
    const auto side = [&](const char* key) { return frustum.number(key, 0, -kLargest, kLargest); };
    const double left = side("left"), right = side("right");
    const double bottom = side("bottom"), top = side("top");
    const double near = frustum.number("near", 1, flat ? 0 : kSmallest, kLargest);
    camera_.znear = near;
    camera_.zfar = INFINITY;
    if (frustum["far"].present()) camera_.zfar = frustum.number("far", 1, 0, kLargest);
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
    if (!look_["direction"].present()) return;
    if (camera_.kind == Camera::Kind::perspective) {
      refuse({"direction"}, "means nothing on a perspective camera");
    }
    const Vec3d d = vec3(look_, "direction", {0, 0, -1}, fault_);
    if (!(d.z < 0)) return fault_.report(look_["direction"].path(), "does not go forwards (z < 0)");
    camera_.slant_x = d.x / -d.z;
    camera_.slant_y = d.y / -d.z;
    if (!(std::fabs(camera_.slant_x) <= 1e6 && std::fabs(camera_.slant_y) <= 1e6)) {
      fault_.report(look_["direction"].path(), "lies in the picture's plane");
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
    out_.sensor_height = lens.number("sensorHeight", out_.sensor_height, kSmallest, kLargest);
    if (lens["focusDistance"].present() == lens["focusNode"].present()) {
      fault_.report(lens.path(), "wants either focusDistance or focusNode");
    }
    out_.focus_node = lens.index("focusNode", document_.nodes.size());
    Lens& l = camera_.lens;
    l.focus_distance = lens.number("focusDistance", 1, kSmallest, kLargest);
    const std::int64_t blades = lens.integer("blades", kMaxBlades + 1);
    l.blades = blades < 0 ? 0 : static_cast<std::int32_t>(blades);
    if (l.blades == 1 || l.blades == 2)
      fault_.report(lens.path() + ".blades", "must be 0 or 3 to 64");
    l.blade_rotation = lens.number("bladeRotation", 0, -1e6, 1e6);
    const JsonView rim = lens["rim"];
    if (!rim.present()) return;
    rim.allow({"distance", "radius"});
    require(rim, {"distance", "radius"}, fault_);
    l.rim_distance = rim.number("distance", 1, kSmallest, kLargest);
    l.rim_radius = rim.number("radius", 1, kSmallest, kLargest);
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

  const JsonView& look_;
  const GltfModel& document_;
  JsonFault& fault_;
  GltfCamera& out_;
  Camera& camera_;
};

}  // namespace

absl::Status read_camera_extensions(const nlohmann::json& root, GltfModel& document) {
  JsonFault fault;
  const std::vector<JsonView> cameras = JsonView(root, "", fault)["cameras"].items();
  for (std::size_t i = 0; i < cameras.size() && i < document.cameras.size(); ++i) {
    const JsonView look = cameras[i].extension("TESSERA_camera");
    if (look.present()) CameraReader(look, document, fault, document.cameras[i]).read();
  }
  return fault.status();
}

}  // namespace tessera::render
