#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/memory_store/memory_rows.h"

namespace tessera::server {

/// Frames in memory; their images are files.
class MemoryFrames final : public FrameStore {
 public:
  /// `folder`: of the images.
  MemoryFrames(MemoryRows& rows, std::string folder) : rows_(rows), folder_(std::move(folder)) {}

  /// Makes output_folder() first call `hook`. Before any other thread exists.
  void on_output_folder(std::function<void(const std::string& job_id)> hook) {
    hook_ = std::move(hook);
  }

  absl::StatusOr<std::string> output_folder(const std::string& job_id) override {
    if (hook_) hook_(job_id);
    const std::string folder = folder_ + "/" + job_id;
    std::filesystem::create_directories(folder);
    return folder;
  }
  absl::Status finish(const std::string& job_id, const FrameRecord& frame) override {
    const std::lock_guard lock(rows_.mutex);
    if (!rows_.commit_fault.ok()) return rows_.commit_fault;
    rows_.frames[job_id][frame.frame] = frame;
    return absl::OkStatus();
  }
  std::int64_t max_row_bytes() const override { return 0; }
  absl::Status finish_small(const std::string& job_id, const FrameRecord& frame,
                            const std::string&) override {
    return finish(job_id, frame);
  }
  absl::Status update_statistics(const std::string& job_id, std::int32_t frame,
                                 const std::string& statistics_json) override {
    const std::lock_guard lock(rows_.mutex);
    if (!rows_.commit_fault.ok()) return rows_.commit_fault;
    rows_.frames.at(job_id).at(frame).statistics_json = statistics_json;
    return absl::OkStatus();
  }
  absl::StatusOr<std::optional<std::string>> row_image(const std::string&,
                                                       std::int32_t) const override {
    return std::nullopt;
  }
  absl::StatusOr<std::vector<FrameRecord>> list(const std::string& job_id) const override {
    const std::lock_guard lock(rows_.mutex);
    std::vector<FrameRecord> frames;
    const auto found = rows_.frames.find(job_id);
    if (found == rows_.frames.end()) return frames;
    for (const auto& [number, frame] : found->second) frames.push_back(frame);
    return frames;
  }

 private:
  MemoryRows& rows_;
  const std::string folder_;
  std::function<void(const std::string& job_id)> hook_;
};

}  // namespace tessera::server
