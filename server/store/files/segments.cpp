#include "server/store/files/segments.h"

#include <algorithm>
#include <charconv>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr std::size_t kMaxOpenSegments = 64;  // for appending, and the same number for reading
constexpr std::size_t kGatherBytes = std::size_t{1} << 20;      // small blocks share a write
constexpr std::int64_t kMaxBlockBytes = std::int64_t{1} << 26;  // a 256×256 tile stays under 16 MiB
constexpr std::string_view kSuffix = ".seg";

/// Returns the number in "NUMBER.seg", or -1.
std::int64_t segment_number(std::string_view name) {
  if (name.size() <= kSuffix.size() || name.substr(name.size() - kSuffix.size()) != kSuffix) {
    return -1;
  }
  name.remove_suffix(kSuffix.size());
  std::int64_t number = -1;
  const auto parsed = std::from_chars(name.data(), name.data() + name.size(), number);
  return parsed.ec == std::errc() && parsed.ptr == name.data() + name.size() ? number : -1;
}

}  // namespace

Segments::Segments(DurableFiles& files, std::string folder, std::int64_t segment_bytes)
    : files_(files), folder_(std::move(folder)), segment_bytes_(segment_bytes) {}

std::string Segments::job_folder(const std::string& job_id) const {
  return absl::StrCat(folder_, "/", job_id);
}

std::string Segments::path(const std::string& job_id, std::int64_t segment) const {
  return absl::StrCat(folder_, "/", job_id, "/", segment, std::string(kSuffix));
}

absl::Status Segments::append(const std::string& job_id, std::int64_t next_segment,
                              std::span<const std::string_view> blocks,
                              std::span<SegmentPosition> positions) {
  const auto found = tail_for(job_id, next_segment);
  if (!found.ok()) return found.status();
  Tail& tail = **found;
  absl::Status written = write_all(tail, blocks, positions);
  if (written.ok()) written = files_.sync(*tail.file);
  if (!written.ok()) {
    tail.abandoned = true;
    tail.file.reset();
  }
  return written;
}

absl::Status Segments::write_all(Tail& tail, std::span<const std::string_view> blocks,
                                 std::span<SegmentPosition> positions) {
  std::string gathered;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    positions[i] = {tail.segment, tail.bytes};
    tail.bytes += static_cast<std::int64_t>(blocks[i].size());
    if (gathered.size() + blocks[i].size() > kGatherBytes && !gathered.empty()) {
      if (absl::Status status = tail.file->append(gathered); !status.ok()) return status;
      gathered.clear();
    }
    if (blocks[i].size() > kGatherBytes) {
      if (absl::Status status = tail.file->append(blocks[i]); !status.ok()) return status;
    } else {
      gathered.append(blocks[i]);
    }
  }
  return tail.file->append(gathered);
}

absl::StatusOr<Segments::Tail*> Segments::tail_for(const std::string& job_id,
                                                   std::int64_t next_segment) {
  const auto [found, is_new] = tails_.try_emplace(job_id);
  Tail& tail = found->second;
  if (is_new || tail.abandoned || tail.bytes >= segment_bytes_) {
    // Numbers continue after an abandoned segment, although it has no row.
    const std::int64_t number = is_new ? next_segment : std::max(next_segment, tail.segment + 1);
    if (absl::Status status = begin_segment(job_id, number, tail); !status.ok()) {
      tail.abandoned = true;
      tail.segment = number;
      tail.file.reset();
      return status;
    }
  } else if (tail.file == nullptr) {
    auto reopened = files_.filesystem().open_existing(path(job_id, tail.segment));
    if (!reopened.ok()) return reopened.status();
    tail.file = *std::move(reopened);
  }
  const auto is_open = [](const auto& entry) { return entry.second.file != nullptr; };
  if (static_cast<std::size_t>(std::count_if(tails_.begin(), tails_.end(), is_open)) >
      kMaxOpenSegments) {
    for (auto& [id, other] : tails_) {
      if (&other != &tail) other.file.reset();
    }
  }
  return &tail;
}

absl::Status Segments::begin_segment(const std::string& job_id, std::int64_t segment, Tail& tail) {
  tail.file.reset();
  if (absl::Status made = files_.ensure_folder(folder_, job_id); !made.ok()) return made;
  auto file = files_.filesystem().open(path(job_id, segment));
  if (!file.ok()) return file.status();
  if (absl::Status synced = files_.sync_folder(job_folder(job_id)); !synced.ok()) return synced;
  const std::int64_t bytes = (*file)->size();
  tail = {segment, *std::move(file), bytes, false};
  return absl::OkStatus();
}

absl::StatusOr<std::string> Segments::read(const std::string& job_id, SegmentPosition position,
                                           std::int64_t size_bytes) const {
  const auto file = open_for_reading(path(job_id, position.segment));
  if (!file.ok()) return file.status();
  if (size_bytes < 0 || size_bytes > kMaxBlockBytes || position.offset < 0) {
    return absl::OutOfRangeError(absl::StrCat(path(job_id, position.segment), ": no block has ",
                                              size_bytes, " bytes at ", position.offset));
  }
  std::string bytes(static_cast<std::size_t>(size_bytes), '\0');
  if (absl::Status status = (*file)->read_at(position.offset, bytes); !status.ok()) return status;
  return bytes;
}

absl::StatusOr<std::shared_ptr<const File>> Segments::open_for_reading(
    const std::string& path) const {
  const MutexLock lock(readers_mutex_);
  const auto same_path = [&](const OpenSegment& open) { return open.path == path; };
  const auto found = std::find_if(readers_.begin(), readers_.end(), same_path);
  if (found != readers_.end()) {
    readers_.splice(readers_.begin(), readers_, found);
    return readers_.front().file;
  }
  auto opened = files_.filesystem().open_existing(path);
  if (!opened.ok()) return opened.status();
  readers_.push_front({path, std::shared_ptr<const File>(*std::move(opened))});
  if (readers_.size() > kMaxOpenSegments) readers_.pop_back();
  return readers_.front().file;
}

void Segments::forget_readers(const std::string& path_prefix) {
  const MutexLock lock(readers_mutex_);
  readers_.remove_if(
      [&](const OpenSegment& open) { return absl::StartsWith(open.path, path_prefix); });
}

absl::Status Segments::release(const std::string& job_id, std::int64_t first_kept) {
  const auto tail = tails_.find(job_id);
  if (tail != tails_.end() && tail->second.segment < first_kept) tails_.erase(tail);
  forget_readers(absl::StrCat(job_folder(job_id), "/"));
  const auto names = files_.filesystem().list(job_folder(job_id));
  if (absl::IsNotFound(names.status())) return absl::OkStatus();
  if (!names.ok()) return names.status();
  for (const std::string& name : *names) {
    const std::int64_t number = segment_number(name);
    if (number < 0 || number >= first_kept) continue;
    absl::Status gone = files_.filesystem().remove(path(job_id, number));
    if (!gone.ok()) return gone;
  }
  return absl::OkStatus();
}

absl::Status Segments::remove_job(const std::string& job_id) {
  tails_.erase(job_id);
  forget_readers(absl::StrCat(job_folder(job_id), "/"));
  return files_.remove_folder(job_folder(job_id));
}

absl::Status Segments::remove_orphans(
    const std::function<bool(const std::string& job_id, std::int64_t segment)>& is_known,
    const std::function<void(const std::string&)>& warn) {
  const auto skip = [&](const absl::Status& status) {
    warn(absl::StrCat("skipped: ", std::string(status.message())));
  };
  const auto jobs = files_.filesystem().list(folder_);
  if (!jobs.ok()) return jobs.status();
  for (const std::string& job_id : *jobs) {
    const auto names = files_.filesystem().list(job_folder(job_id));
    if (!names.ok()) {
      skip(names.status());
      continue;
    }
    std::size_t kept_count = 0;
    for (const std::string& name : *names) {
      if (is_known(job_id, segment_number(name))) {
        ++kept_count;
        continue;
      }
      const std::string orphan = absl::StrCat(job_folder(job_id), "/", name);
      const absl::Status gone = files_.filesystem().remove(orphan);
      if (gone.ok()) continue;
      skip(gone);
      ++kept_count;
    }
    if (kept_count != 0) continue;
    if (const absl::Status gone = files_.remove_folder(job_folder(job_id)); !gone.ok()) skip(gone);
  }
  return absl::OkStatus();
}

}  // namespace tessera::server
