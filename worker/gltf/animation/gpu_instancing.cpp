#include "worker/gltf/animation/gpu_instancing.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/gltf/decode/accessor_reader.h"
#include "worker/gltf/model/hierarchy.h"

namespace tessera::render {

absl::StatusOr<std::vector<Affine3d>> instance_transforms(const GltfModel& model,
                                                          const Node& node) {
  for (const auto& [name, accessor] : node.instancing) {
    if (model.accessors[accessor].view == kNone) {
      return absl::InvalidArgumentError(
          absl::StrCat("accessors[", accessor, "]: instance attributes require a bufferView"));
    }
  }
  const auto attribute = [&](const char* name) {
    const auto it = node.instancing.find(name);
    return it == node.instancing.end() ? kNone : it->second;
  };
  const std::int32_t t = attribute("TRANSLATION"), r = attribute("ROTATION"),
                     s = attribute("SCALE");
  std::vector<Vec3f> translations, scales;
  std::vector<Vec4f> rotations;
  const auto read = [](auto values, auto& to) {
    absl::Status result = values.status();
    if (values.ok()) to = *std::move(values);
    return result;
  };
  absl::Status status;
  if (t != kNone) status = read(read_vec3(model, t), translations);
  if (status.ok() && r != kNone) status = read(read_vec4(model, r), rotations);
  if (status.ok() && s != kNone) status = read(read_vec3(model, s), scales);
  if (!status.ok()) return status;
  const std::int32_t first = node.instancing.begin()->second;
  std::vector<Affine3d> transforms(static_cast<std::size_t>(model.accessors[first].count));
  for (std::size_t i = 0; i < transforms.size(); ++i) {
    Node local;
    if (t != kNone) local.translation = Vec3d(translations[i]);
    if (s != kNone) local.scale = Vec3d(scales[i]);
    if (r != kNone) {
      local.rotation = {rotations[i].x, rotations[i].y, rotations[i].z, rotations[i].w};
    }
    transforms[i] = local_transform(local);
  }
  return transforms;
}

}  // namespace tessera::render
