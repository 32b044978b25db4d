#include "client/request/job_request.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <random>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/output/frame_files.h"
#include "client/output/true_error.h"
#include "client/request/scene_report.h"
#include "contract/digest.h"
#include "rpc/settings_message.h"
#include "telemetry/log/printable.h"

namespace tessera::client {
namespace {

absl::StatusOr<v1::AssetId> identify(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return absl::InvalidArgumentError(absl::StrCat(path, ": cannot read the file"));
  contract::Hasher hasher;
  std::int64_t size = 0;
  std::string buffer(64 << 10, '\0');
  while (file.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) ||
         file.gcount() > 0) {
    hasher.update(std::string_view(buffer.data(), static_cast<std::size_t>(file.gcount())));
    size += file.gcount();
  }
  v1::AssetId id;
  id.set_sha256(hasher.finish().binary());
  id.set_size_bytes(size);
  return id;
}

/// Returns the URI of the environment map in the manifest, which no scene can use by accident.
std::string environment_uri(const std::string& path, const v1::AssetId& id) {
  const std::string digest = contract::Digest::from_binary(id.sha256())->hex();
  return absl::StrCat("environment-", digest.substr(0, 16), "/",
                      clean_name(path.substr(path.rfind('/') + 1)));
}

absl::Status report_errors(const SceneReport& scene) {
  std::string lines;
  for (const SceneReport::Problem& problem : scene.problems) {
    if (problem.severity != "error") continue;
    absl::StrAppend(&lines, lines.empty() ? "" : "\n", problem.text());
  }
  return absl::InvalidArgumentError(lines);
}

/// Writes a reference in the asset format: the whole frame, zero outside the window.
absl::Status write_reference(const std::string& path, const Image& image, const Window& window) {
  constexpr std::int64_t kPixelBytes = 4 * sizeof(float);
  const contract::PixelRect& rect = window.rect;
  std::ofstream file(path, std::ios::binary);
  for (std::int32_t row = 0; row < rect.height; ++row) {
    file.seekp(kPixelBytes * (std::int64_t{rect.y + row} * window.width + rect.x));
    file.write(
        reinterpret_cast<const char*>(
            &image.rgba[4 * static_cast<std::size_t>(row) * static_cast<std::size_t>(rect.width)]),
        kPixelBytes * rect.width);
  }
  file.close();
  std::error_code error;
  std::filesystem::resize_file(
      path, static_cast<std::uintmax_t>(kPixelBytes * window.width * window.height), error);
  if (file && !error) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(path, ": cannot write the file"));
}

/// Reads the reference images and writes them as assets.
absl::Status add_references(const std::string& path, const contract::RenderSettings& settings,
                            PreparedJob& job) {
  const Window window{settings.width, settings.height, settings.window()};
  auto images = read_references(path, contract::frame_list(settings.frames), window);
  if (!images.ok()) return images.status();
  job.references = *std::move(images);
  job.folder = std::make_shared<PrivateFolder>();
  for (const Image& image : job.references) {
    const std::string asset =
        absl::StrCat(job.folder->path(), "/reference.", job.request.references_size());
    absl::Status status = write_reference(asset, image, window);
    if (!status.ok()) return status;
    auto id = identify(asset);
    if (!id.ok()) return id.status();
    job.files.emplace(id->sha256(), asset);
    *job.request.add_references() = *std::move(id);
  }
  return absl::OkStatus();
}

// Limits of the server; one more line says that warnings were omitted.
constexpr int kMaxWarnings = 100;
constexpr std::size_t kMaxWarningBytes = 4000;

/// Returns the first `most` bytes of UTF-8 text, without cutting a character.
std::string beginning_of(const std::string& text, std::size_t most) {
  if (text.size() <= most) return text;
  std::size_t end = most;
  while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0u) == 0x80u) --end;
  return text.substr(0, end);
}

/// Adds problems to the remarks, and warnings to the request for the report.
void add_remarks(const SceneReport& scene, PreparedJob& job) {
  for (const SceneReport::Problem& problem : scene.problems) {
    job.remarks.push_back(problem.text());
    if (problem.severity != "warning" || job.request.scene_warnings_size() > kMaxWarnings) continue;
    job.request.add_scene_warnings(job.request.scene_warnings_size() < kMaxWarnings
                                       ? beginning_of(printable(problem.text()), kMaxWarningBytes)
                                       : "further warnings of the scene are omitted");
  }
}

}  // namespace

absl::StatusOr<PreparedJob> prepare_job(const RenderOptions& options, const std::string& name) {
  std::string environment;
  if (!options.environment.empty()) {
    const auto id = identify(options.environment);
    if (!id.ok()) return id.status();
    environment = environment_uri(options.environment, *id);
  }
  const auto settings = settings_of(options, environment);
  if (!settings.ok()) return settings.status();
  const auto scene = inspect_scene(options.scene, options.environment, &*settings);
  if (!scene.ok()) return scene.status();
  if (scene->has_errors()) return report_errors(*scene);
  PreparedJob job;
  add_remarks(*scene, job);
  std::map<std::string, std::string> files;  // path by URI, in the manifest's order
  for (const auto& resource : scene->resources) files.emplace(resource.uri, resource.file);
  v1::SceneManifest& manifest = *job.request.mutable_manifest();
  manifest.set_scene_uri(scene->scene_uri);
  for (const auto& [uri, path] : files) {
    auto id = identify(path);
    if (!id.ok()) return id.status();
    job.files.emplace(id->sha256(), path);
    v1::ManifestEntry& entry = *manifest.add_assets();
    entry.set_uri(uri);
    *entry.mutable_asset() = *std::move(id);
  }
  *job.request.mutable_settings() = contract::to_message(*settings);
  job.request.set_name(name.empty() ? stem_of(options.scene) : name);
  if (!options.reference.empty()) {
    absl::Status status = add_references(options.reference, *settings, job);
    if (!status.ok()) return status;
  }
  return job;
}

absl::Status upload_missing(FarmClient& client, const PreparedJob& job) {
  std::map<std::string, v1::AssetId> assets;
  for (const v1::ManifestEntry& entry : job.request.manifest().assets()) {
    assets.emplace(entry.asset().sha256(), entry.asset());
  }
  for (const v1::AssetId& id : job.request.references()) assets.emplace(id.sha256(), id);
  std::vector<v1::AssetId> wanted;
  wanted.reserve(assets.size());
  for (const auto& [sha256, id] : assets) wanted.push_back(id);
  const auto missing = client.find_missing_assets(wanted);
  if (!missing.ok()) return missing.status();
  for (const v1::AssetId& id : *missing) {
    absl::Status status = client.upload_asset(id, job.files.at(id.sha256()));
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

std::string derived_request_id(const v1::CreateJobRequest& request) {
  v1::CreateJobRequest named = request;
  named.clear_request_id();
  named.clear_references();
  named.clear_scene_warnings();
  return contract::sha256(named.SerializeAsString()).hex();
}

std::string random_request_id() {
  std::random_device random;
  std::string bytes;
  for (int i = 0; i < 8; ++i) absl::StrAppend(&bytes, random(), ".");
  return contract::sha256(bytes).hex();
}

}  // namespace tessera::client
