#include "worker/gltf/build/loader.h"

#include <algorithm>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>

#include "absl/strings/str_cat.h"
#include "worker/gltf/animation/animation.h"
#include "worker/gltf/animation/animation_pointers.h"
#include "worker/gltf/animation/shutter.h"
#include "worker/gltf/build/scene_builder.h"
#include "worker/gltf/decode/accessor_reader.h"
#include "worker/gltf/decode/compression.h"
#include "worker/gltf/decode/image_decoder.h"
#include "worker/gltf/extensions/extension_reader.h"
#include "worker/gltf/extensions/medium_reader.h"
#include "worker/gltf/file/container.h"
#include "worker/gltf/file/limits.h"
#include "worker/gltf/model/core_model.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/gltf/model/lax_parts.h"
#include "worker/gltf/model/preprocess.h"
#include "worker/scene/texture_refs.h"

namespace tessera::render {

namespace {

absl::Status in_file(const std::string& file, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(file, ": ", status.message()));
}

class LoadedScene final : public SceneFile {
 public:
  explicit LoadedScene(std::string name) : name_(std::move(name)) {}

  const std::vector<Problem>& problems() const override { return model_.problems; }
  const std::vector<std::string>& resources() const override { return model_.resources; }

  SceneContents contents() const override {
    SceneContents out;
    for (const GltfScene& s : model_.scenes) out.scenes.push_back(s.name);
    for (const GltfCamera& c : model_.cameras) out.cameras.push_back(c.camera.name);
    for (std::size_t i = 0; i < model_.animations.size(); ++i) {
      out.animations.push_back(
          {model_.animations[i].name, clip_seconds(model_, static_cast<std::int32_t>(i))});
    }
    out.variants = model_.variants;
    out.extensions_used = model_.extensions_used;
    out.extensions_required = model_.extensions_required;
    return out;
  }

  absl::StatusOr<Scene> pose(const contract::RenderSettings& settings,
                             std::int32_t frame) const override {
    const auto animations = choose_animations(model_, settings.animation);
    if (!animations.ok()) return in_file(name_, animations.status());
    PoseCache cache = last_pose();
    GltfModel animated;
    const bool pointers = has_pointers(model_, *animations);
    const double seconds = static_cast<double>(frame) / settings.fps;
    if (pointers) {
      auto read = animated_model(*animations, seconds);
      if (!read.ok()) return in_file(name_, read.status());
      animated = *std::move(read);
      // Animated material properties can change which vertex attributes a mesh needs.
      cache.meshes.clear();
      cache.bases.clear();
    }
    PoseInput input{pointers ? animated : model_,
                    *reader_,
                    has_environment_ ? &environment_ : nullptr,
                    settings,
                    seconds,
                    std::nullopt};
    std::vector<Problem> problems;
    auto scene = pose_over_exposure(*animations, input, cache, problems);
    remember(problems);
    if (!scene.ok()) return in_file(name_, scene.status());
    store_pose(std::move(cache));
    return scene;
  }

  absl::Status load(const contract::RenderSettings& settings, ResourceReader& reader) {
    reader_ = &reader;
    absl::Status status = read_file(reader);
    if (status.ok() && !settings.environment.empty()) status = read_environment(settings, reader);
    return status;
  }

 private:
  absl::Status read_file(ResourceReader& reader) {
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
    absl::Status status = check_extensions(*root, model_);
    if (status.ok()) warn_of_lax_parts(*root, model_);
    if (status.ok()) status = resolve_buffers(*root, *container, reader, model_);
    if (status.ok()) status = expand_meshopt(*root, model_);
    if (status.ok()) status = expand_draco(*root, model_);
    if (!status.ok()) return status;
    const auto core = core_text(*root, model_.faults);
    if (!core.ok()) return core.status();
    status = read_core_model(*core, model_);
    if (!status.ok()) return status;
    check_views(model_);
    status = check_accessors(model_);
    if (status.ok()) status = read_images(*root, model_);
    if (status.ok()) status = read_extensions(*root, model_);
    if (status.ok()) status = read_animation_pointers(*root, model_);
    if (!status.ok()) return status;
    check_animations(model_);
    fetch_images(reader);
    const bool animated = std::any_of(model_.animations.begin(), model_.animations.end(),
                                      [](const Animation& a) { return !a.pointers.empty(); });
    if (animated) root_ = std::make_unique<nlohmann::json>(*std::move(root));
    return status;
  }

  static absl::Status read_extensions(const nlohmann::json& root, GltfModel& model) {
    absl::Status status = read_texture_extensions(root, model);
    if (status.ok()) status = read_material_extensions(root, model);
    if (status.ok()) status = read_node_extensions(root, model);
    if (status.ok()) status = read_camera_extensions(root, model);
    if (status.ok()) status = read_atmospheres(root, model);
    return status;
  }

  static absl::StatusOr<Scene> pose_over_exposure(const std::vector<std::int32_t>& animations,
                                                  const PoseInput& input, PoseCache& cache,
                                                  std::vector<Problem>& problems) {
    auto posed = build_scene(input, cache, problems);
    if (!posed.ok()) return posed.status();
    if (!animations.empty()) {
      absl::Status status = add_exposure(animations, input, cache, problems, posed->scene);
      if (!status.ok()) return status;
    }
    if ((input.settings.aovs & contract::kAovMotion) != 0) {
      absl::Status status = add_neighbours(input, cache, posed->scene);
      if (!status.ok()) return status;
    }
    return finish_scene(input.model, *std::move(posed), problems);
  }

  /// Adds the poses of the previous and the next frame. Properties animated by pointers keep their
  /// values at the frame's time.
  static absl::Status add_neighbours(PoseInput input, PoseCache& cache, Scene& scene) {
    const double seconds = input.seconds, step = 1 / input.settings.fps;
    input.center = scene.center;
    for (const bool later : {false, true}) {
      input.seconds = later ? seconds + step : seconds - step;
      std::vector<Problem> ignored;
      auto posed = build_scene(input, cache, ignored);
      if (!posed.ok()) return posed.status();
      posed->scene.images.clear();
      (later ? scene.after : scene.before) = std::make_shared<const Scene>(std::move(posed->scene));
    }
    return absl::OkStatus();
  }

  /// Adds the motion during the shutter of the scene's camera, if it has one. Properties animated
  /// by pointers keep their values at the frame's time.
  static absl::Status add_exposure(const std::vector<std::int32_t>& animations, PoseInput input,
                                   PoseCache& cache, std::vector<Problem>& problems, Scene& scene) {
    const Camera& camera = scene.camera;
    if (!(camera.shutter_open < camera.shutter_close)) return absl::OkStatus();
    ShutterInterval shutter;
    shutter.open = input.seconds + camera.shutter_open;
    shutter.close = input.seconds + camera.shutter_close;
    shutter.changes = animation_keys(input.model, animations, shutter.open, shutter.close);
    shutter.memory_bytes = input.reader.memory_bytes();
    input.center = scene.center;
    shutter.pose = [&](double seconds) -> absl::StatusOr<Scene> {
      input.seconds = seconds;
      std::vector<Problem> ignored;
      auto posed = build_scene(input, cache, ignored);
      if (!posed.ok()) return posed.status();
      return std::move(posed->scene);
    };
    return add_motion(shutter, scene, problems);
  }

  /// The model with properties that pointers animate set to their values at `seconds`. Shares
  /// buffers and images with model_, which must outlive it.
  absl::StatusOr<GltfModel> animated_model(const std::vector<std::int32_t>& animations,
                                           double seconds) const {
    nlohmann::json root = *root_;
    absl::Status status = animate_json(model_, animations, seconds, root);
    if (!status.ok()) return status;
    GltfModel out;
    out.faults = model_.faults;
    const auto core = core_text(root, out.faults);
    if (!core.ok()) return core.status();
    out.buffers = model_.buffers;
    out.images = model_.images;
    out.texture_sources = model_.texture_sources;
    status = read_core_model(*core, out);
    if (status.ok()) status = read_extensions(root, out);
    if (!status.ok()) return status;
    out.animations = model_.animations;
    return out;
  }

  /// Reads the files of the images that materials use.
  void fetch_images(ResourceReader& reader) {
    for (Material& material : model_.materials) {
      for (const TextureRef* ref : texture_refs(material)) {
        if (!*ref) continue;
        const GltfTexture& texture = model_.texture_sources[ref->texture];
        if (texture.procedural != kNone) continue;
        if (texture.basisu_only) {
          const std::string where = absl::StrCat("textures[", ref->texture, "]");
          model_.faults.add(where,
                            absl::UnimplementedError(absl::StrCat(
                                where,
                                ": KHR_texture_basisu without a fallback image is not supported; "
                                "give the texture a PNG or JPEG source too")));
        }
        if (texture.image != kNone) model_.images[texture.image].needed = true;
      }
    }
    for (std::size_t i = 0; i < model_.images.size(); ++i) {
      GltfImage& image = model_.images[i];
      if (!image.needed || image.uri.empty()) continue;
      const auto bytes = reader.read(image.uri);
      if (!bytes.ok()) {
        model_.faults.add(absl::StrCat("images[", i, "]"), in_file(image.name, bytes.status()));
        continue;
      }
      image.bytes = *bytes;
      auto& resources = model_.resources;
      if (std::find(resources.begin(), resources.end(), image.uri) == resources.end()) {
        resources.push_back(image.uri);
      }
    }
  }

  absl::Status read_environment(const contract::RenderSettings& settings, ResourceReader& reader) {
    const auto file = reader.read(settings.environment);
    if (!file.ok()) return in_file(settings.environment, file.status());
    auto environment = decode_environment(*file, settings.environment, reader.memory_bytes());
    if (!environment.ok()) return in_file(settings.environment, environment.status());
    environment_ = *std::move(environment);
    has_environment_ = true;
    return absl::OkStatus();
  }

  PoseCache last_pose() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return cache_;
  }

  void store_pose(PoseCache cache) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    cache_ = std::move(cache);
  }

  /// Adds new problems to the model's, up to kMaxProblems.
  void remember(const std::vector<Problem>& problems) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const Problem& problem : problems) {
      if (reported_.size() > kMaxProblems) return;
      if (!reported_.insert(problem.element + ": " + problem.message).second) continue;
      model_.problems.push_back(
          reported_.size() <= kMaxProblems
              ? problem
              : Problem{Problem::Severity::warning, "", "further warnings are omitted"});
    }
  }

  std::string name_;
  mutable std::mutex mutex_;  // guards model_.problems, reported_ and cache_
  mutable PoseCache cache_;   // of the last pose
  mutable std::set<std::string> reported_;
  mutable GltfModel model_;                     // after load(), only `problems` changes
  std::unique_ptr<const nlohmann::json> root_;  // if animations have pointers
  Image environment_;
  ResourceReader* reader_ = nullptr;
  bool has_environment_ = false;
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
