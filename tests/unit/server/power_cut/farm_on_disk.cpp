#include "tests/unit/server/power_cut/farm_on_disk.h"

#include <algorithm>
#include <fstream>
#include <sstream>

#include "absl/strings/str_cat.h"
#include "contract/pass_schedule.h"
#include "contract/tile_grid.h"
#include "tests/unit/server/store/durability_checker.h"

namespace tessera::server {
namespace {

constexpr char kWorker[] = "worker";
constexpr char kScene[] = "the bytes of a scene";
constexpr int kCredits = 7;        // odd: runs and groups do not end with passes
constexpr std::size_t kSends = 3;  // blocks per round

/// The one job: two frames of 3 × 2 tiles in two passes.
JobSpec the_job() {
  JobSpec spec;
  spec.name = "job";
  spec.request_id = "request";
  spec.settings.width = 20;
  spec.settings.height = 12;
  spec.settings.tile = 8;
  spec.settings.spp = 16;
  spec.settings.frames = {{1, 2, 1}};
  spec.assets = {{"scene.glb", contract::sha256(kScene), sizeof(kScene) - 1}};
  spec.request = absl::StrCat(spec.settings.spp, " ", spec.priority);
  return spec;
}

/// Extensions and updates change these settings, which the request of a job contains.
std::string request_of(const JobSpec& spec) {
  return absl::StrCat(spec.settings.spp, " ", spec.priority);
}

JobSpec read_request(const std::string& request) {
  JobSpec spec = the_job();
  spec.request = request;
  std::istringstream(request) >> spec.settings.spp >> spec.priority;
  return spec;
}

std::string block_of(const UnitName& name, const Lease& lease) {
  const contract::PixelRect rect = contract::TileGrid(the_job().settings).rect(name.unit.tile);
  contract::FilmBlock block =
      contract::FilmBlock::zeros({rect.width, rect.height, 0, name.unit.pass == 0});
  const int seed = 31 * name.unit.frame + 7 * name.unit.tile + 3 * name.unit.pass;
  for (std::size_t i = 0; i < block.rgb.size(); ++i) {
    block.rgb[i] = static_cast<float>((static_cast<int>(i) + seed) % 17) * 0.125f;
  }
  for (float& alpha : block.alpha) alpha = static_cast<float>(lease.sample_count);
  return contract::encode(block);
}

}  // namespace

class FarmOnDisk::Link final : public WorkerConnection {
 public:
  void wake() override {}
  void close(const absl::Status& /*reason*/) override {}
};

FarmOnDisk::FarmOnDisk(const std::string& root, bool uses_rows)
    : root_(root), uses_rows_(uses_rows), disk_(root), link_(std::make_shared<Link>()) {}

FarmOnDisk::~FarmOnDisk() {
  coordinator_.reset();
  store_.reset();
}

absl::Status FarmOnDisk::start() {
  StoreOptions store_options;
  store_options.checkpoint_pages = 58;  // after the scene is acknowledged, before the end
  store_options.segment_bytes = 20'000;
  if (!uses_rows_) {
    store_options.row_block_bytes = store_options.row_image_bytes = store_options.row_asset_bytes =
        0;
  }
  auto store = Store::open(root_ + "/store", disk_, store_options);
  if (!store.ok()) return store.status();
  store_ = *std::move(store);
  random_ = static_cast<std::uint64_t>(store_->boot_count());  // no job ID twice
  FarmOptions options;
  options.clock = [this] { return now_ += std::chrono::milliseconds(1); };
  options.wall_us = [] { return std::int64_t{1'700'000'000'000'000}; };
  options.random = [this] {
    return random_ = random_ * 6364136223846793005u + 1442695040888963407u;
  };
  options.read_spec = [](const JobRecord& record) -> absl::StatusOr<JobSpec> {
    JobSpec spec = read_request(record.request);
    spec.id = record.id;
    return spec;
  };
  options.write_request = request_of;
  auto coordinator = Coordinator::open(*store_, std::move(options));
  if (!coordinator.ok()) return coordinator.status();
  coordinator_ = *std::move(coordinator);
  return absl::OkStatus();
}

void FarmOnDisk::pump() {
  while (coordinator_->run_writer(false) || coordinator_->run_answers(false) ||
         coordinator_->run_film(false)) {
  }
}

contract::Digest FarmOnDisk::scene_digest() const {
  return contract::sha256(kScene);
}

absl::StatusOr<int> FarmOnDisk::upload_scene() {
  const contract::Digest digest = scene_digest();
  if (coordinator_->assets().has_asset(digest)) return step();
  absl::StatusOr<int> answer = absl::UnknownError("no answer");
  const auto note = [&](const absl::Status& status) {
    answer = status.ok() ? absl::StatusOr<int>(step()) : status;
  };
  if (uses_rows_) {
    coordinator_->assets().add_asset(digest, kScene, note);
  } else {
    const auto path = coordinator_->assets().new_upload_path();
    if (!path.ok()) return path.status();
    std::ofstream(*path, std::ios::binary) << kScene;
    coordinator_->assets().publish_asset(*path, digest, note);
  }
  pump();
  return answer;
}

absl::StatusOr<std::string> FarmOnDisk::submit(const std::string& request_id) {
  JobSpec spec = the_job();
  spec.request_id = request_id;
  absl::StatusOr<std::string> answer = absl::UnknownError("no answer");
  coordinator_->admission().create_job(
      spec, [&](const absl::StatusOr<JobAdmission::Created>& created) {
        answer =
            created.ok() ? absl::StatusOr<std::string>(created->view.spec->id) : created.status();
      });
  pump();
  return answer;
}

void FarmOnDisk::connect(const WorkerLog& held) {
  Hello hello;
  hello.worker_id = hello.name = kWorker;
  hello.thread_count = 2;
  hello.credit_count = std::max(0, kCredits - static_cast<int>(held.size()));
  hello.store_id = store_->id();
  std::set<Attempt> attempts;
  for (const auto& [name, entry] : held) {
    hello.unacknowledged.push_back(name);
    waiting_.emplace_back(name, entry.lease);
    if (attempts.insert(entry.lease.attempt).second) hello.leases.push_back(entry.lease);
  }
  session_ = coordinator_->workers().join(hello, link_).session;
}

void FarmOnDisk::collect() {
  Outbox outbox = coordinator_->workers().take_outbox(session_);
  for (const Lease& lease : outbox.leases) {
    for (std::int32_t i = 0; i < lease.tile_count; ++i) {
      const UnitName name{lease.job_id, {lease.frame, lease.first_tile + i, lease.pass}};
      leased_.insert(name);
      waiting_.emplace_back(name, lease);
    }
  }
  int acknowledged_count = 0;
  for (const Acknowledgement& acknowledgement : outbox.acknowledgements) {
    WorkerEntry& entry = log_[acknowledgement.unit];
    entry.acknowledged_step = step();
    entry.status = acknowledgement.status;
    ++acknowledged_count;
  }
  if (acknowledged_count > 0) coordinator_->workers().grant_credits(session_, acknowledged_count);
}

void FarmOnDisk::send(const UnitName& name, const Lease& lease) {
  const std::string bytes = block_of(name, lease);
  const BlockHeader header{lease, name.unit.tile, static_cast<std::int64_t>(bytes.size()),
                           contract::sha256(bytes), 0.5};
  WorkerEntry& entry = log_[name];
  entry.lease = lease;
  entry.sent_step = step();
  const auto admission = coordinator_->intake().admit(kWorker, header);
  if (admission) coordinator_->intake().deliver(kWorker, header, *admission, bytes);
}

void FarmOnDisk::work() {
  coordinator_->tick();
  collect();
  const std::size_t count = std::min(kSends, waiting_.size());
  for (std::size_t i = 0; i < count; ++i) send(waiting_[i].first, waiting_[i].second);
  waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(count));
  pump();
  collect();
}

absl::Status FarmOnDisk::finish_job(const std::string& job_id) {
  constexpr int kMaxRounds = 1000;
  for (int round = 0; round < kMaxRounds; ++round) {
    work();
    const auto view = coordinator_->queries().job(job_id);
    if (!view.ok()) return view.status();
    if (has_ended(view->state)) return absl::OkStatus();
  }
  return absl::DeadlineExceededError("the job does not end");
}

absl::Status FarmOnDisk::change(const std::string& job_id, JobAdmin::Change what) {
  absl::Status answer = absl::UnknownError("no answer");
  coordinator_->jobs().change_job(job_id, what, [&](const auto& view) { answer = view.status(); });
  pump();
  return answer;
}

absl::Status FarmOnDisk::extend(const std::string& job_id, std::int32_t spp) {
  absl::Status answer = absl::UnknownError("no answer");
  coordinator_->jobs().extend_job(job_id, {spp, {}},
                                  [&](const auto& view) { answer = view.status(); });
  pump();
  return answer;
}

absl::Status FarmOnDisk::set_priority(const std::string& job_id, std::int32_t priority) {
  JobAdmin::Update update;
  update.priority = priority;
  absl::Status answer = absl::UnknownError("no answer");
  coordinator_->jobs().update_job(job_id, update,
                                  [&](const auto& view) { answer = view.status(); });
  pump();
  return answer;
}

absl::Status FarmOnDisk::remove(const std::string& job_id) {
  absl::Status answer = absl::UnknownError("no answer");
  coordinator_->jobs().remove_job(job_id, [&](const absl::Status& status) { answer = status; });
  pump();
  return answer;
}

std::vector<std::string> FarmOnDisk::pixels(const std::string& job_id) {
  std::vector<std::string> pixels;
  const auto frames = store_->frames().list(job_id);
  const auto folder = store_->frames().output_folder(job_id);
  if (!frames.ok() || !folder.ok()) return {};
  for (const FrameRecord& frame : *frames) {
    const auto image = store_->frames().row_image(job_id, frame.frame);
    if (!image.ok()) return {};
    const std::string bytes = image->has_value() ? **image : read_file(*folder + "/" + frame.file);
    const bool is_intact = contract::sha256(bytes) == frame.file_sha256;
    pixels.push_back(is_intact ? frame.pixels_sha256.hex() : "damaged");
  }
  return pixels;
}

}  // namespace tessera::server
