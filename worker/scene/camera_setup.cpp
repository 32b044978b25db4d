#include "worker/scene/camera_setup.h"

#include <cmath>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace tessera::render {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kFramingYfov = 0.69813170079773184;  // 40 degrees
constexpr double kSin20Degrees = 0.34202014332566873;

Affine3d from_axes(const Vec3d& x, const Vec3d& y, const Vec3d& z, const Vec3d& origin) {
  return {{Vec3d{x.x, y.x, z.x}, Vec3d{x.y, y.y, z.y}, Vec3d{x.z, y.z, z.z}}, origin};
}

Camera frame_everything(const PosedNodes& nodes) {
  Camera camera;
  camera.name = "framed";
  camera.yfov = kFramingYfov;
  const double r = length(nodes.bounds_max - nodes.bounds_min) / 2;
  const Vec3d back = normalize(Vec3d{0.5, 0.35, 1});
  const double distance = (r > 0 ? r : 1) / kSin20Degrees;
  const Vec3d middle = (nodes.bounds_min + nodes.bounds_max) * 0.5;
  const Vec3d right = normalize(cross(Vec3d{0, 1, 0}, back));
  camera.camera_to_world = from_axes(right, cross(back, right), back, middle + back * distance);
  return camera;
}

absl::Status check_camera(const Camera& camera, const std::string& where) {
  const bool perspective = camera.kind == Camera::Kind::perspective;
  const bool valid = perspective ? camera.yfov > 0 && camera.yfov < kPi
                                 : camera.ymag > 0 && std::isfinite(camera.ymag);
  if (!valid) {
    return absl::InvalidArgumentError(
        absl::StrCat(where, perspective ? ": yfov is not in (0, pi)" : ": ymag is not above 0"));
  }
  if (!(camera.znear >= 0 && camera.zfar > camera.znear)) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": znear and zfar are out of order"));
  }
  return absl::OkStatus();
}

/// The node that carries the camera `wanted`; kNone if there is none in the scene.
std::int32_t find_camera_node(const Document& document, const std::string& wanted,
                              const std::vector<std::int32_t>& order) {
  std::int32_t index = kNone;
  if (!absl::SimpleAtoi(wanted, &index)) index = kNone;
  std::int32_t by_index = kNone;
  for (const std::int32_t node : order) {
    const std::int32_t camera = document.nodes[node].camera;
    if (camera == kNone) continue;
    if (wanted.empty() || document.nodes[node].name == wanted ||
        document.cameras[camera].name == wanted) {
      return node;
    }
    if (camera == index && by_index == kNone) by_index = node;
  }
  return by_index;
}

std::string known_cameras(const Document& document, const std::vector<std::int32_t>& order) {
  std::string out;
  for (const std::int32_t node : order) {
    const std::int32_t camera = document.nodes[node].camera;
    if (camera == kNone || out.size() > 500) continue;
    const std::string& own = document.cameras[camera].name;
    absl::StrAppend(&out, out.empty() ? "" : ", ", camera, " \"",
                    own.empty() ? document.nodes[node].name : own, "\"");
  }
  return out.empty() ? "none" : out;
}

}  // namespace

std::optional<Affine3d> rigid_part(const Affine3d& world) {
  const auto column = [&](int k) {
    return Vec3d{world.rows[0][k], world.rows[1][k], world.rows[2][k]};
  };
  const Vec3d z = normalize(column(2));
  const Vec3d up = normalize(column(1));
  const Vec3d y = normalize(up - z * dot(z, up));
  const Vec3d x = cross(y, z);
  const double size = max_abs(z) + max_abs(y) + max_abs(x) + max_abs(world.translation);
  if (z == Vec3d{} || y == Vec3d{} || !std::isfinite(size)) return std::nullopt;
  return from_axes(x, y, z, world.translation);
}

absl::StatusOr<Camera> set_up_camera(const Document& document,
                                     const contract::RenderSettings& settings,
                                     const PosedNodes& nodes, std::vector<Problem>& problems) {
  const std::int32_t node = find_camera_node(document, settings.camera, nodes.order);
  if (node == kNone) {
    if (settings.camera.empty()) return frame_everything(nodes);
    return absl::InvalidArgumentError(absl::StrCat("camera: there is no \"", settings.camera,
                                                   "\" in the scene; it has ",
                                                   known_cameras(document, nodes.order)));
  }
  Camera camera = document.cameras[document.nodes[node].camera];
  const std::string where = absl::StrCat("cameras[", document.nodes[node].camera, "]");
  absl::Status valid = check_camera(camera, where);
  auto placed = rigid_part(nodes.world[node]);
  if (valid.ok() && !placed) {
    valid = absl::InvalidArgumentError(absl::StrCat("nodes[", node, "]: a singular camera node"));
  }
  if (!valid.ok()) {
    if (!settings.camera.empty()) return valid;
    problems.push_back({Problem::Severity::warning, where,
                        absl::StrCat(valid.message(), "; the whole scene is framed instead")});
    return frame_everything(nodes);
  }
  if (camera.name.empty()) camera.name = document.nodes[node].name;
  placed->translation = placed->translation - nodes.center;
  camera.camera_to_world = *placed;
  return camera;
}

}  // namespace tessera::render
