#include "server/frames/frame_films.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::server {

using contract::Unit;

namespace {

constexpr std::int64_t kReferencePixelBytes = 16;

}  // namespace

absl::StatusOr<contract::FilmBlock> FrameFilms::read_block(const std::string& job_id,
                                                           const Unit& unit) {
  std::optional<UnitRecord> record;
  contract::FilmBlockShape shape;
  std::int32_t sample_count = 0;
  {
    FarmChange change(farm_);
    Job* job = change.find_job(job_id);
    if (job == nullptr || !job->plan || !job->plan->contains(unit)) {
      return absl::NotFoundError("the job or the pass no longer exists");
    }
    JobFilm& film = change.film(*job);
    record = film.open_block_index(*job).record(unit);
    const contract::PixelRect rect = film.open_grid(*job).rect(unit.tile);
    shape = {rect.width, rect.height, job->spec->settings.aovs, unit.pass == 0};
    sample_count = job->plan->shape().passes[static_cast<std::size_t>(unit.pass)].sample_count;
  }
  if (!record) return absl::NotFoundError("block not committed");
  farm_.metrics().film_blocks.read_back.Increment();
  const auto bytes = store_.units().read_block(job_id, *record);
  if (absl::IsDataLoss(bytes.status())) {
    const MutexLock lock(mutex_);
    damaged_[{job_id, unit.frame}].push_back(unit);
  }
  if (!bytes.ok()) return bytes.status();
  return contract::decode(*bytes, shape, sample_count);
}

/// Returns a reader of the frame's reference, if the job has one: an asset with R, G, B, A of each
/// pixel as little-endian float32, like the input of pixels_sha256.
ReferenceReader FrameFilms::reference_reader(const JobSpec& spec, std::int32_t frame) {
  if (spec.references.empty()) return {};
  const std::vector<std::int32_t> frames = contract::frame_list(spec.settings.frames);
  const auto index = std::find(frames.begin(), frames.end(), frame) - frames.begin();
  const contract::Digest& digest = spec.references[static_cast<std::size_t>(index)];
  return [this, id = spec.id, digest, width = std::int64_t{spec.settings.width}](
             const contract::PixelRect& rect) -> absl::StatusOr<std::vector<float>> {
    const auto asset = store_.assets().open(digest);
    absl::Status status = asset.status();
    const std::size_t row_floats = 4 * static_cast<std::size_t>(rect.width);
    std::vector<float> pixels(row_floats * static_cast<std::size_t>(rect.height));
    for (std::int32_t row = 0; row < rect.height && status.ok(); ++row) {
      char* const out =
          reinterpret_cast<char*>(&pixels[static_cast<std::size_t>(row) * row_floats]);
      status = asset->read_at(((rect.y + row) * width + rect.x) * kReferencePixelBytes,
                              {out, row_floats * sizeof(float)});
    }
    if (status.ok()) return pixels;
    farm_.log(LogLevel::warn,
              absl::StrCat("job ", id, ": cannot read the reference: ", status.ToString()));
    return absl::DataLossError(status.message());
  };
}

bool FrameFilms::is_current(const FarmView& farm, const FrameKey& key) const {
  const Job* job = farm.find_job(key.job_id);
  const MutexLock lock(mutex_);
  const auto opened = revisions_.find(key);
  return job != nullptr && opened != revisions_.end() && opened->second == farm.film(*job).revision;
}

bool FrameFilms::open(const FrameKey& key) {
  std::shared_ptr<const JobSpec> spec;
  std::vector<Unit> units;
  {
    FarmChange change(farm_);
    Job* job = change.find_job(key.job_id);
    if (job == nullptr || is_current(change, key)) return false;
    spec = job->spec;
    JobFilm& film = change.film(*job);
    units = film.open_block_index(*job).units(key.frame);
    const MutexLock lock(mutex_);
    revisions_[key] = film.revision;
  }
  cache_.close_frame(key);
  cache_.open_frame(
      key, spec->settings,
      [this, key](std::int32_t tile, std::int32_t pass) {
        return read_block(key.job_id, {key.frame, tile, pass});
      },
      reference_reader(*spec, key.frame));
  for (const Unit& unit : units) {
    const absl::Status status = cache_.record_committed(key, unit.tile, unit.pass);
    if (!status.ok()) {
      farm_.log(LogLevel::error, absl::StrCat("job ", key.job_id, ": ", status.ToString()));
    }
  }
  return true;
}

void FrameFilms::close(const FrameKey& key) {
  cache_.close_frame(key);
  take_damaged(key);
  const MutexLock lock(mutex_);
  revisions_.erase(key);
}

std::vector<Unit> FrameFilms::take_damaged(const FrameKey& key) {
  const MutexLock lock(mutex_);
  const auto found = damaged_.find(key);
  if (found == damaged_.end()) return {};
  std::vector<Unit> units = std::move(found->second);
  damaged_.erase(found);
  return units;
}

}  // namespace tessera::server
