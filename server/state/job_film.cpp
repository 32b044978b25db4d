#include "server/state/job_film.h"

#include <algorithm>

#include "contract/pass_schedule.h"
#include "server/state/failed_attempts.h"

namespace tessera::server {

using contract::Unit;

const contract::TileGrid& JobFilm::open_grid(const Job& job) {
  if (!grid) grid = std::make_shared<const contract::TileGrid>(job.spec->settings);
  return *grid;
}

BlockIndex& JobFilm::open_block_index(Job& job) {
  if (!block_index) {
    const JobPlan& plan = job.open_plan();
    block_index.emplace(plan.shape().tile_count,
                        static_cast<std::int32_t>(plan.shape().passes.size()));
  }
  return *block_index;
}

std::int64_t JobFilm::unit_samples(Job& job, const Unit& unit) {
  const contract::PixelRect rect = open_grid(job).rect(unit.tile);
  const auto pass = static_cast<std::size_t>(unit.pass);
  return std::int64_t{rect.width} * rect.height * job.open_plan().shape().passes[pass].sample_count;
}

void JobFilm::count_finished(const FrameRecord& record, const FrameSummary& summary) {
  image_bytes += record.image_bytes - finished[record.frame].image_bytes;
  FrameRecord& kept = finished[record.frame] = record;
  kept.statistics_json.clear();
  if (summary.estimated_error) estimated_error = summary.estimated_error;
  warnings.insert(warnings.end(), summary.doubts.begin(), summary.doubts.end());
  expected_samples.erase(record.frame);
  finished_samples += summary.samples;
  if (summary.certainty) {
    certainty = std::max(certainty.value_or(*summary.certainty), *summary.certainty);
  }
}

void JobFilm::reset() {
  ++revision;
  block_index.reset();
  finished.clear();
  expected_samples.clear();
  certainty.reset();
  committed_samples = finished_samples = 0;
  image_bytes = 0;
}

std::int64_t JobFilm::sample_count(const Job& job) const {
  const contract::RenderSettings& settings = job.spec->settings;
  const contract::PixelRect window = settings.window();
  const std::int64_t pixels = std::int64_t{window.width} * window.height;
  if (!settings.error) {
    return std::int64_t{job.frame_count} * pixels * contract::rounded_spp(settings.spp);
  }
  std::int64_t known = finished_samples;
  for (const auto& [frame, samples] : expected_samples) known += samples;
  const auto started = static_cast<std::int64_t>(finished.size() + expected_samples.size());
  const std::vector<contract::Pass> passes = contract::schedule(settings);
  const auto first =
      std::min(passes.size(), static_cast<std::size_t>(contract::kUnconditionalPasses)) - 1;
  const std::int64_t each = started > 0 ? known / started : pixels * passes[first].end();
  return known + (job.frame_count - started) * each;
}

JobView JobFilm::view(const Job& job, Time now) const {
  JobView view;
  view.key = job.key;
  view.spec = job.spec;
  view.state = job.state;
  view.reason = job.reason;
  view.failure_code = job.failure_code;
  view.failed_attempts = job.failed_attempts;
  view.create_time_us = create_time_us;
  view.end_time_us = end_time_us;
  view.unit_count = job.plan ? job.plan->counts().planned : job.unit_count;
  view.frame_count = job.frame_count;
  if (job.plan) {
    view.committed_unit_count = job.plan->counts().committed;
    view.leased_unit_count = job.plan->counts().in_flight;
    view.finished_frame_count = job.plan->finished_frame_count();
  }
  view.committed_sample_count = committed_samples;
  view.sample_count = std::max(sample_count(job), committed_samples);
  if (job.state == JobState::done && job.spec->settings.error) view.certainty = certainty;
  view.worker_count = static_cast<std::int32_t>(job.holders.size());
  view.cpu_seconds = job.counters.cpu_seconds;
  view.estimated_error = estimated_error;
  view.elapsed_seconds = job.wall_seconds(now);
  const auto gained = static_cast<double>(committed_samples - samples_at_start);
  if (!has_ended(job.state) && gained > 0 && job.running_since) {
    const double spent = view.elapsed_seconds - wall_at_start;
    view.remaining_seconds =
        spent * static_cast<double>(view.sample_count - view.committed_sample_count) / gained;
  }
  return view;
}

JobRecord JobFilm::record(const Job& job, Time now) const {
  JobRecord record;
  record.id = job.spec->id;
  record.sequence = job.key;
  record.request_id = job.spec->request_id;
  record.name = job.spec->name;
  record.owner = job.spec->owner;
  record.request = job.spec->request;
  record.state = static_cast<std::int32_t>(job.state);
  record.reason = job.reason;
  record.failure_code = static_cast<std::int32_t>(job.failure_code);
  record.create_time_us = create_time_us;
  record.end_time_us = end_time_us;
  record.end_served_us = end_served_us.value_or(0);
  record.wall_seconds = job.wall_seconds(now);
  record.render_contract = job.spec->render_contract;
  record.project = job.spec->project;
  record.failed_attempts = write_failed_attempts(job.failed_attempts);
  return record;
}

}  // namespace tessera::server
