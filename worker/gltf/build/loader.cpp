#include "worker/gltf/build/loader.h"

#include <algorithm>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "worker/gltf/decode/accessor_reader.h"
#include "worker/gltf/animation/animation.h"
#include "worker/gltf/animation/animation_pointers.h"
#include "worker/gltf/decode/compression.h"
#include "worker/gltf/file/container.h"
#include "worker/gltf/model/core_model.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/gltf/extensions/extension_reader.h"
#include "worker/gltf/model/preprocess.h"
#include "worker/gltf/decode/image_decoder.h"
#include "worker/gltf/file/limits.h"
#include "worker/gltf/extensions/medium_reader.h"
#include "worker/gltf/build/scene_builder.h"
#include "worker/gltf/animation/shutter.h"
#include "worker/scene/texture_refs.h"

namespace tessera::render {

namespace {

absl::Status in_file(const std::string& file, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(file, ": ", status.message()));
}

class LoadedScene final : public SceneFile {
 public:
  explicit LoadedScene(std::string name) : name_(std::move(name)) {}

  const std::vector<Problem>& problems() const override { return document_.problems; }
  const std::vector<std::string>& resources() const override { return document_.resources; }

  SceneContents contents() const override {
    SceneContents out;
    for (const GltfScene& s : document_.scenes) out.scenes.push_back(s.name);
    for (const GltfCamera& c : document_.cameras) out.cameras.push_back(c.camera.name);
    for (std::size_t i = 0; i < document_.animations.size(); ++i) {
      out.animations.push_back(
          {document_.animations[i].name, clip_seconds(document_, static_cast<std::int32_t>(i))});
    }
    out.variants = document_.variants;
    out.extensions_used = document_.extensions_used;
    out.extensions_required = document_.extensions_required;
    return out;
  }

  absl::StatusOr<Scene> pose(const contract::RenderSettings& settings,
                             std::int32_t frame) const override {
    const auto animations = choose_animations(document_, settings.animation);
    if (!animations.ok()) return in_file(name_, animations.status());
    PoseCache cache = last_pose();
    GltfModel animated;
    const bool pointers = has_pointers(document_, *animations);
    const double seconds = static_cast<double>(frame) / settings.fps;
    if (pointers) {
      auto read = animated_document(*animations, seconds);
      if (!read.ok()) return in_file(name_, read.status());
      animated = *std::move(read);
      // What a mesh needs may follow from numbers of its materials.
      cache.meshes.clear();
      cache.bases.clear();
    }
    PoseInput input{pointers ? animated : document_,
                    *reader_,
                    has_sky_ ? &sky_ : nullptr,
                    settings,
                    seconds,
                    std::nullopt};
    std::vector<Problem> met;
    auto scene = build_scene(input, cache, met);
    if (scene.ok() && !animations->empty()) {
      absl::Status status = open_shutter(*animations, input, cache, met, *scene);
      if (!status.ok()) scene = status;
    }
    remember(met);
    if (!scene.ok()) return in_file(name_, scene.status());
    keep(std::move(cache));
    return scene;
  }

  absl::Status load(const contract::RenderSettings& settings, ResourceReader& reader) {
    reader_ = &reader;
    absl::Status status = read_document(reader);
    if (status.ok() && !settings.environment.empty()) status = read_sky(settings, reader);
    return status;
  }

 private:
  absl::Status read_document(ResourceReader& reader) {
    const auto file = reader.read(name_);
    if (!file.ok()) return in_file(name_, file.status());
    absl::Status status = read_gltf(*file, reader);
    return status.ok() ? status : in_file(name_, status);
  }

  absl::Status read_gltf(std::span<const std::byte> file, ResourceReader& reader) {
    const auto container = split_container(file);
    if (!container.ok()) return container.status();
    auto root = parse_json(container->json);
    if (!root.ok()) return root.status();
    absl::Status status = check_extensions(*root, document_);
    if (status.ok()) status = resolve_buffers(*root, *container, reader, document_);
    if (status.ok()) status = expand_meshopt(*root, document_);
    if (status.ok()) status = expand_draco(*root, document_);
    if (!status.ok()) return status;
    const auto core = core_text(*root);
    if (!core.ok()) return core.status();
    status = read_core_model(*core, document_);
    if (status.ok()) status = check_views(document_);
    if (status.ok()) status = check_accessors(document_);
    if (status.ok()) status = read_images(*root, document_);
    if (status.ok()) status = read_extensions(*root, document_);
    if (status.ok()) status = read_animation_pointers(*root, document_);
    if (status.ok()) status = check_animations(document_);
    if (status.ok()) status = fetch_images(reader);
    const bool animated = std::any_of(document_.animations.begin(), document_.animations.end(),
                                      [](const Animation& a) { return !a.pointers.empty(); });
    if (animated) root_ = std::make_unique<nlohmann::json>(*std::move(root));
    return status;
  }

  static absl::Status read_extensions(const nlohmann::json& root, GltfModel& document) {
    absl::Status status = read_texture_extensions(root, document);
    if (status.ok()) status = read_material_extensions(root, document);
    if (status.ok()) status = read_node_extensions(root, document);
    if (status.ok()) status = read_camera_extensions(root, document);
    if (status.ok()) status = read_atmospheres(root, document);
    return status;
  }

  /// Adds what moves while the shutter of the scene's camera is open, if it has one. Numbers that
  /// pointers animate stay as they are at the frame's time.
  static absl::Status open_shutter(const std::vector<std::int32_t>& animations, PoseInput input,
                                   PoseCache& cache, std::vector<Problem>& met, Scene& scene) {
    const Camera& camera = scene.camera;
    if (!(camera.shutter_open < camera.shutter_close)) return absl::OkStatus();
    ShutterInterval exposure;
    exposure.open = input.seconds + camera.shutter_open;
    exposure.close = input.seconds + camera.shutter_close;
    exposure.changes = animation_keys(input.document, animations, exposure.open, exposure.close);
    input.center = scene.center;
    exposure.pose = [&](double seconds) {
      input.seconds = seconds;
      std::vector<Problem> said_before;
      return build_scene(input, cache, said_before);
    };
    return add_motion(exposure, scene, met);
  }

  /// The document with the numbers that pointers animate as they are at a time. Buffers and
  /// images are those of the first reading, which must outlive it.
  absl::StatusOr<GltfModel> animated_document(const std::vector<std::int32_t>& animations,
                                             double seconds) const {
    nlohmann::json root = *root_;
    absl::Status status = animate_json(document_, animations, seconds, root);
    if (!status.ok()) return status;
    const auto core = core_text(root);
    if (!core.ok()) return core.status();
    GltfModel out;
    out.buffers = document_.buffers;
    out.images = document_.images;
    out.texture_sources = document_.texture_sources;
    status = read_core_model(*core, out);
    if (status.ok()) status = read_extensions(root, out);
    if (!status.ok()) return status;
    out.animations = document_.animations;
    return out;
  }

  /// Reads the files of the images that materials name.
  absl::Status fetch_images(ResourceReader& reader) {
    for (Material& material : document_.materials) {
      for (const TextureRef* ref : texture_refs(material)) {
        if (!*ref) continue;
        const GltfTexture& texture = document_.texture_sources[ref->texture];
        if (texture.procedure != kNone) continue;
        if (texture.basisu_only) {
          return absl::UnimplementedError(
              absl::StrCat("textures[", ref->texture,
                           "]: KHR_texture_basisu without a fallback image is not supported; "
                           "give the texture a PNG or JPEG source too"));
        }
        if (texture.image != kNone) document_.images[texture.image].needed = true;
      }
    }
    for (GltfImage& image : document_.images) {
      if (!image.needed || image.uri.empty()) continue;
      auto& resources = document_.resources;
      if (std::find(resources.begin(), resources.end(), image.uri) == resources.end()) {
        resources.push_back(image.uri);
      }
      const auto bytes = reader.read(image.uri);
      if (!bytes.ok()) return in_file(image.name, bytes.status());
      image.bytes = *bytes;
    }
    return absl::OkStatus();
  }

  absl::Status read_sky(const contract::RenderSettings& settings, ResourceReader& reader) {
    const auto file = reader.read(settings.environment);
    if (!file.ok()) return in_file(settings.environment, file.status());
    auto sky = decode_environment(*file, settings.environment);
    if (!sky.ok()) return in_file(settings.environment, sky.status());
    sky_ = *std::move(sky);
    has_sky_ = true;
    return absl::OkStatus();
  }

  PoseCache last_pose() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return cache_;
  }

  void keep(PoseCache cache) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    cache_ = std::move(cache);
  }

  /// Adds what has not been said before, up to kMaxProblems.
  void remember(const std::vector<Problem>& met) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const Problem& problem : met) {
      if (said_.size() > kMaxProblems) return;
      if (!said_.insert(problem.element + ": " + problem.message).second) continue;
      document_.problems.push_back(
          said_.size() <= kMaxProblems
              ? problem
              : Problem{Problem::Severity::warning, "", "further warnings are left out"});
    }
  }

  std::string name_;
  mutable std::mutex mutex_;  // guards document_.problems, said_ and cache_
  mutable PoseCache cache_;   // of the last pose
  mutable std::set<std::string> said_;
  mutable GltfModel document_;                   // after load() only `problems` changes
  std::unique_ptr<const nlohmann::json> root_;  // if animations have pointers
  Image sky_;
  ResourceReader* reader_ = nullptr;
  bool has_sky_ = false;
};

}  // namespace

absl::StatusOr<std::unique_ptr<SceneFile>> load_scene_file(std::string_view uri,
                                                           const contract::RenderSettings& settings,
                                                           ResourceReader& reader) {
  auto scene = std::make_unique<LoadedScene>(std::string(uri));
  absl::Status status = scene->load(settings, reader);
  if (!status.ok()) return status;
  return std::unique_ptr<SceneFile>(std::move(scene));
}

}  // namespace tessera::render
