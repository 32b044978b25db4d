#include "client/cli/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera::client {
namespace {

constexpr int kMaxBarLength = 40, kMinBarLength = 8;

std::string figures(const v1::Job& job, double share) {
  const v1::JobProgress& progress = job.progress();
  std::string text = absl::StrFormat("%3.0f %%", std::floor(100 * share));
  if (progress.frame_count() > 1) {
    absl::StrAppend(&text, "  frame ", progress.finished_frame_count(), "/",
                    progress.frame_count());
  }
  absl::StrAppend(&text, "  ", format_count(static_cast<double>(progress.committed_sample_count())),
                  " samples");
  if (progress.has_estimated_error()) {
    absl::StrAppend(&text, "  error ", absl::StrFormat("%.3g", progress.estimated_error()));
  }
  absl::StrAppend(&text, "  ", progress.worker_count(),
                  progress.worker_count() == 1 ? " worker" : " workers");
  if (progress.has_remaining()) {
    absl::StrAppend(&text, "  ", format_seconds(to_seconds(progress.remaining())), " left");
  }
  if (job.state() == v1::Job::STATE_PAUSED) absl::StrAppend(&text, "  paused");
  if (!job.reason().empty()) absl::StrAppend(&text, "  ", job.reason());
  return text;
}

}  // namespace

std::string format_count(double count) {
  for (const char* unit : {"", " k", " M", " G"}) {
    if (count < 1000) return absl::StrFormat("%.*f%s", *unit == 0 ? 0 : 1, count, unit);
    count /= 1000;
  }
  return absl::StrFormat("%.1f T", count);
}

double to_seconds(const google::protobuf::Duration& span) {
  return static_cast<double>(span.seconds()) + 1e-9 * span.nanos();
}

std::string format_seconds(double seconds) {
  if (seconds < 60) return absl::StrFormat("%.*f s", seconds < 10 ? 1 : 0, seconds);
  const auto whole = std::lround(seconds);
  if (whole < 3600) return absl::StrFormat("%d:%02d", whole / 60, whole % 60);
  return absl::StrFormat("%d:%02d:%02d", whole / 3600, whole / 60 % 60, whole % 60);
}

std::string progress_line(const v1::Job& job, int columns) {
  const v1::JobProgress& progress = job.progress();
  const double share = progress.sample_count() == 0
                           ? 0
                           : static_cast<double>(progress.committed_sample_count()) /
                                 static_cast<double>(progress.sample_count());
  std::string text = figures(job, share);
  const int room = std::min(kMaxBarLength, columns - static_cast<int>(text.size()) - 4);
  if (room >= kMinBarLength) {
    const int filled = std::clamp(static_cast<int>(share * room), 0, room);
    text = absl::StrCat("[", std::string(static_cast<std::size_t>(filled), '#'),
                        std::string(static_cast<std::size_t>(room - filled), '.'), "] ", text);
  }
  if (columns > 1 && static_cast<int>(text.size()) >= columns) {
    text.resize(static_cast<std::size_t>(columns - 1));
  }
  return text;
}

ProgressBar::ProgressBar() : terminal_(isatty(STDERR_FILENO) == 1) {}

void ProgressBar::show(const v1::Job& job) {
  if (!terminal_) return;
  winsize window{};
  const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &window) == 0 && window.ws_col > 0;
  std::fprintf(stderr, "\r\033[K%s", progress_line(job, known ? window.ws_col : 80).c_str());
  std::fflush(stderr);
  drawn_ = true;
}

void ProgressBar::clear() {
  if (!drawn_) return;
  std::fprintf(stderr, "\r\033[K");
  std::fflush(stderr);
  drawn_ = false;
}

}  // namespace tessera::client
