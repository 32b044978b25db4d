#include "worker/renderer/loaded_frames.h"

#include <chrono>

#include "absl/strings/str_cat.h"
#include "rpc/settings_message.h"
#include "worker/accelerators/recording/recorded_rays.h"
#include "worker/accelerators/structure_accelerator.h"
#include "worker/gltf/build/loader.h"

namespace tessera::agent {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// The production BVH, or the structure that the job names.
render::TraceOptions trace_options(render::Isa isa, const contract::RenderSettings& settings) {
  const auto* structure = render::accelerators::find_structure(settings.accelerator);
  if (structure == nullptr) return isa;
  return {isa, [structure, settings](const render::Scene& scene) {
            std::vector<render::Ray> sample;
            if (structure->takes_rays) {
              auto rays = render::record_rays(scene, settings);
              if (rays.ok()) sample = std::move(rays->visible);  // else create() fails likewise
            }
            return std::make_unique<const render::accelerators::StructureAccelerator>(
                scene, *structure, sample);
          }};
}

}  // namespace

absl::StatusOr<LoadedFrames::Outcome> LoadedFrames::load(const v1::LoadScene& command,
                                                         std::vector<Descriptor> descriptors,
                                                         const render::ParallelFor& parallel_for) {
  auto settings = contract::from_message(command.settings());
  if (!settings.ok()) return settings.status();
  const auto start = Clock::now();
  Outcome outcome;
  std::unique_ptr<render::FrameRenderer> renderer;
  {
    const auto job = job_scene(command, *settings, std::move(descriptors));
    if (!job.ok()) return job.status();
    auto scene = (*job)->file->pose(*settings, command.frame());
    if (!scene.ok()) return scene.status();
    outcome.load_seconds = seconds_since(start);
    const auto build_start = Clock::now();
    const auto other = any_frame(command.job_id());
    auto made = render::FrameRenderer::create(
        *std::move(scene), *settings, command.frame(), parallel_for,
        other == nullptr ? nullptr : other->renderer.get(), trace_options(isa_, *settings));
    if (!made.ok()) return made.status();
    renderer = *std::move(made);
    outcome.build_seconds = seconds_since(build_start);
    outcome.accelerator_build_seconds = renderer->timings().accel_build_seconds;
    outcome.accelerator_bytes = renderer->accel().memory_bytes();
  }
  auto loaded = std::make_shared<const LoadedFrame>(
      LoadedFrame{*settings, contract::TileGrid(*settings), std::move(renderer)});
  const std::lock_guard lock(mutex_);
  frames_[{command.job_id(), command.frame()}] = std::move(loaded);
  return outcome;
}

absl::StatusOr<std::shared_ptr<LoadedFrames::JobScene>> LoadedFrames::job_scene(
    const v1::LoadScene& command, const contract::RenderSettings& settings,
    std::vector<Descriptor> descriptors) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = jobs_.find(command.job_id());
    if (found != jobs_.end()) return found->second;
  }
  auto job = std::make_shared<JobScene>();
  job->reader =
      std::make_unique<DescriptorReader>(command.manifest(), std::move(descriptors), memory_);
  auto file = render::load_scene_file(command.manifest().scene_uri(), settings, *job->reader);
  if (!file.ok()) return file.status();
  job->file = *std::move(file);
  if (contract::frame_count(settings.frames) > 1) {  // a single frame uses its file only once
    const std::lock_guard lock(mutex_);
    jobs_[command.job_id()] = job;
  }
  return job;
}

std::shared_ptr<const LoadedFrame> LoadedFrames::any_frame(const std::string& job_id) {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.lower_bound({job_id, 0});
  return found == frames_.end() || found->first.first != job_id ? nullptr : found->second;
}

std::shared_ptr<const LoadedFrame> LoadedFrames::find(const std::string& job_id,
                                                      std::int32_t frame) {
  const std::lock_guard lock(mutex_);
  const auto found = frames_.find({job_id, frame});
  return found == frames_.end() ? nullptr : found->second;
}

void LoadedFrames::unload(const v1::UnloadScene& command) {
  const std::lock_guard lock(mutex_);
  if (command.has_frame()) {
    frames_.erase({command.job_id(), command.frame()});
    return;
  }
  jobs_.erase(command.job_id());
  std::erase_if(frames_, [&](const auto& entry) { return entry.first.first == command.job_id(); });
}

}  // namespace tessera::agent
