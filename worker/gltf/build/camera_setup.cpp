#include "worker/gltf/build/camera_setup.h"

#include <cmath>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "worker/math/elementary.h"
#include "worker/scene/visible_bounds.h"

namespace tessera::render {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kFramingYfov = 0.69813170079773184;  // 40 degrees
constexpr double kSin20Degrees = 0.34202014332566873, kTan20Degrees = 0.36397023426620234;

Affine3d from_axes(const Vec3d& x, const Vec3d& y, const Vec3d& z, const Vec3d& origin) {
  return {{Vec3d{x.x, y.x, z.x}, Vec3d{x.y, y.y, z.y}, Vec3d{x.z, y.z, z.z}}, origin};
}

/// Sine of half the smaller angle of view.
double sine_of_half_angle(const contract::RenderSettings& settings) {
  if (settings.width >= settings.height) return kSin20Degrees;
  const double tangent = kTan20Degrees * settings.width / settings.height;
  return tangent / std::sqrt(1 + tangent * tangent);
}

/// A camera whose pyramid of view touches the sphere around the scene's box.
Camera frame_everything(const PosedNodes& nodes, const contract::RenderSettings& settings) {
  Camera camera;
  camera.name = "framed";
  camera.yfov = kFramingYfov;
  Box3d box = visible_bounds(nodes.scene);
  if (box.empty()) box = {nodes.scene.bounds_min, nodes.scene.bounds_max};
  const double r = length(box.hi - box.lo) / 2;
  const Vec3d back = normalize(Vec3d{0.5, 0.35, 1});
  const double distance = (r > 0 ? r : 1) / sine_of_half_angle(settings);
  const Vec3d middle = (box.lo + box.hi) * 0.5;
  const Vec3d right = normalize(cross(Vec3d{0, 1, 0}, back));
  camera.camera_to_world = from_axes(right, cross(back, right), back, middle + back * distance);
  return camera;
}

absl::Status check_camera(const Camera& camera, const std::string& where) {
  if (camera.kind == Camera::Kind::perspective && !(camera.yfov > 0 && camera.yfov < kPi)) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": yfov is not in (0, pi)"));
  }
  if (camera.kind == Camera::Kind::orthographic &&
      !(camera.ymag > 0 && std::isfinite(camera.ymag))) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": ymag is not above 0"));
  }
  if (!(camera.znear >= 0 && camera.zfar > camera.znear)) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": znear and zfar are out of order"));
  }
  return absl::OkStatus();
}

/// Node with the camera `wanted` (empty: the first camera); kNone if the scene has none.
std::int32_t find_camera_node(const GltfModel& model, const std::string& wanted,
                              const std::vector<std::int32_t>& order) {
  std::int32_t index = kNone;
  if (!absl::SimpleAtoi(wanted, &index)) index = kNone;
  std::int32_t by_index = kNone;
  for (const std::int32_t node : order) {
    const std::int32_t camera = model.nodes[node].camera;
    if (camera == kNone) continue;
    if (wanted.empty() || model.nodes[node].name == wanted ||
        model.cameras[camera].camera.name == wanted) {
      return node;
    }
    if (camera == index && by_index == kNone) by_index = node;
  }
  return by_index;
}

std::string known_cameras(const GltfModel& model, const std::vector<std::int32_t>& order) {
  std::string out;
  for (const std::int32_t node : order) {
    const std::int32_t camera = model.nodes[node].camera;
    if (camera == kNone || out.size() > 500) continue;
    const std::string& own = model.cameras[camera].camera.name;
    absl::StrAppend(&out, out.empty() ? "" : ", ", camera, " \"",
                    own.empty() ? model.nodes[node].name : own, "\"");
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

namespace {

/// Transform from the space of the camera's node to that of its lookAt; nullopt if degenerate.
std::optional<Affine3d> look_at_transform(const LookAt& look) {
  const Vec3d z = normalize(look.position - look.target);
  const Vec3d x = normalize(cross(look.up, z));
  if (z == Vec3d{} || x == Vec3d{}) return std::nullopt;
  return from_axes(x, cross(z, x), z, look.position);
}

/// Transform of the camera, not recentred.
absl::StatusOr<Affine3d> place_camera(const GltfCamera& source, const Affine3d& world,
                                      std::int32_t node, const std::string& where) {
  Affine3d local;
  if (source.look_at) {
    const auto look = look_at_transform(*source.look_at);
    if (!look) {
      return absl::InvalidArgumentError(
          absl::StrCat(where,
                       ".extensions.TESSERA_camera.lookAt: position, target and up do not "
                       "define a direction"));
    }
    local = *look;
  }
  auto placed = rigid_part(source.look_at ? world * local : world);
  if (placed) return *placed;
  return absl::InvalidArgumentError(
      absl::StrCat("nodes[", node, "]: the camera's node has a singular transform"));
}

/// Sets the lens radius from the f-number, and the focus distance. The focal length is the one at
/// which the sensor's height covers the field of view, so yfov does not depend on the focus.
absl::Status set_up_lens(const GltfCamera& source, const std::vector<Affine3d>& world,
                         const std::string& where, const Affine3d& placed, Camera& camera) {
  if (source.f_number == 0) return absl::OkStatus();
  const double half_height =
      elementary::sin(0.5 * camera.yfov) / elementary::cos(0.5 * camera.yfov);
  const double focal_length = 0.5 * source.sensor_height / half_height;
  camera.lens.radius = 0.5 * focal_length / source.f_number;
  if (source.focus_node == kNone) return absl::OkStatus();
  const Vec3d back{placed.rows[0].z, placed.rows[1].z, placed.rows[2].z};
  const Vec3d target = world[source.focus_node].translation;
  camera.lens.focus_distance = dot(placed.translation - target, back);
  if (camera.lens.focus_distance > 0) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(where, ".extensions.TESSERA_camera.lens.focusNode: nodes[", source.focus_node,
                   "] is not in front of the camera"));
}

/// Warns if the clip planes of the camera leave nothing to see. The box around the scene may be too
/// large, so that some such cameras are not found, but a camera that sees something never is.
void warn_of_clip_planes(const Camera& camera, const Scene& scene, const std::string& where,
                         std::vector<Problem>& problems) {
  if (camera.kind != Camera::Kind::perspective && camera.kind != Camera::Kind::orthographic) return;
  const Vec3d back{camera.camera_to_world.rows[0].z, camera.camera_to_world.rows[1].z,
                   camera.camera_to_world.rows[2].z};
  const Vec3d half = (scene.bounds_max - scene.bounds_min) * 0.5;
  const Vec3d middle = (scene.bounds_max + scene.bounds_min) * 0.5;
  const double depth = dot(camera.camera_to_world.translation - middle, back);
  const double reach =
      std::abs(back.x) * half.x + std::abs(back.y) * half.y + std::abs(back.z) * half.z;
  if (!(half.x >= 0) || depth + reach <= 0) return;  // no scene, or all of it is behind the camera
  if (depth + reach < camera.znear) {
    problems.push_back(
        {Problem::Severity::warning, where,
         absl::StrCat("the camera sees nothing: it clips what is nearer than znear, ", camera.znear,
                      " m, and the scene ends at ", depth + reach, " m")});
  } else if (depth - reach > camera.zfar) {
    problems.push_back(
        {Problem::Severity::warning, where,
         absl::StrCat("the camera sees nothing: it clips what is farther than zfar, ", camera.zfar,
                      " m, and the scene begins at ", depth - reach, " m")});
  }
}

}  // namespace

absl::StatusOr<Camera> set_up_camera(const GltfModel& model,
                                     const contract::RenderSettings& settings,
                                     const PosedNodes& nodes, std::vector<Problem>& problems) {
  const std::int32_t node = find_camera_node(model, settings.camera, nodes.order);
  if (node == kNone) {
    if (settings.camera.empty()) return frame_everything(nodes, settings);
    return absl::InvalidArgumentError(absl::StrCat("camera: \"", settings.camera,
                                                   "\" not found; the scene has ",
                                                   known_cameras(model, nodes.order)));
  }
  const GltfCamera& source = model.cameras[model.nodes[node].camera];
  Camera camera = source.camera;
  const std::string where = absl::StrCat("cameras[", model.nodes[node].camera, "]");
  if (const absl::Status* fault = model.faults.find("cameras", model.nodes[node].camera)) {
    return *fault;
  }
  absl::Status valid = check_camera(camera, where);
  auto placed = place_camera(source, nodes.world[node], node, where);
  if (valid.ok()) valid = placed.status();
  if (valid.ok()) valid = set_up_lens(source, nodes.world, where, *placed, camera);
  if (!valid.ok()) {
    if (!settings.camera.empty()) return valid;
    problems.push_back({Problem::Severity::warning, where,
                        absl::StrCat(valid.message(), "; framing the whole scene instead")});
    return frame_everything(nodes, settings);
  }
  if (camera.name.empty()) camera.name = model.nodes[node].name;
  placed->translation = placed->translation - nodes.scene.center;
  camera.camera_to_world = *placed;
  warn_of_clip_planes(camera, nodes.scene, where, problems);
  return camera;
}

}  // namespace tessera::render
