// Measures how many units and bytes per second the store makes durable.
//
//   store_bench FOLDER       a directory on a real disk; tmpfs is refused, syncs cost nothing there
//
// Prints one line per group size: a coordinator commits in one group all blocks that arrived while
// the previous group was being written, so groups grow with the load. Film blocks contain noise, as
// after a few samples per pixel. Compares uncompressed blocks with zstd over byte planes.

#include <sys/vfs.h>
#include <zstd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "contract/film_block.h"
#include "server/store/store.h"
#include "tests/support/cpu_seconds.h"

namespace tessera::server {
namespace {

using testing::cpu_seconds;

constexpr long kTmpfsMagic = 0x01021994;
constexpr double kSeconds = 3;  // per line

double now_seconds() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

/// Makes a block like that of a path tracer: smooth shading times exponential noise of `samples`.
std::string noisy_block(std::mt19937& rng, int edge, int samples) {
  contract::FilmBlock block = contract::FilmBlock::zeros({edge, edge, 0, false});
  std::exponential_distribution<double> noise(1.0);
  for (std::size_t i = 0; i < block.rgb.size(); i += 3) {
    double light = 0;
    for (int s = 0; s < samples; ++s) light += noise(rng);
    const double shade = 0.2 + 0.6 * static_cast<double>(i) / static_cast<double>(block.rgb.size());
    block.rgb[i] = static_cast<float>(light * shade);
    block.rgb[i + 1] = static_cast<float>(light * shade * 0.8);
    block.rgb[i + 2] = static_cast<float>(light * shade * 0.55);
  }
  for (float& alpha : block.alpha) alpha = static_cast<float>(4 * samples);
  return contract::encode(block);
}

std::vector<Commit> make_group(const std::vector<std::string>& blocks,
                               const std::vector<contract::Digest>& digests, int count, int& next) {
  std::vector<Commit> group(static_cast<std::size_t>(count));
  for (Commit& commit : group) {
    const std::size_t pick = static_cast<std::size_t>(next) % blocks.size();
    commit.job_id = "job";
    commit.record.unit = {0, next++, 0};
    commit.record.sha256 = digests[pick];
    commit.record.worker_id = "worker-0123456789abcdef";
    commit.record.cpu_seconds = 0.01;
    commit.block = blocks[pick];
  }
  return group;
}

/// Commits groups of `count` blocks for kSeconds and prints the rates.
absl::Status measure(const std::string& folder, const std::vector<std::string>& blocks, int count) {
  std::filesystem::remove_all(folder + "/store");
  auto store = Store::open(folder + "/store", real_filesystem());
  if (!store.ok()) return store.status();
  JobRecord job;
  job.id = "job";
  if (absl::Status added = (*store)->jobs().add(job); !added.ok()) return added;
  std::vector<contract::Digest> digests;
  digests.reserve(blocks.size());
  for (const std::string& block : blocks) digests.push_back(contract::sha256(block));
  int next = 0;
  int commits = 0;
  const double cpu_start = cpu_seconds();
  const double start = now_seconds();
  double seconds = 0;
  while (seconds < kSeconds) {
    std::vector<Commit> group = make_group(blocks, digests, count, next);
    if (absl::Status committed = (*store)->units().commit(group); !committed.ok()) return committed;
    ++commits;
    seconds = now_seconds() - start;
  }
  const double bytes = static_cast<double>(next) * static_cast<double>(blocks.front().size());
  std::printf(
      "%7zu-byte blocks, %4d a group: %7.0f units/s %7.1f MB/s %6.2f ms/group, CPU %3.0f %%\n",
      blocks.front().size(), count, next / seconds, bytes / seconds / 1e6, 1e3 * seconds / commits,
      100 * (cpu_seconds() - cpu_start) / seconds);
  store->reset();
  std::filesystem::remove_all(folder + "/store");
  return absl::OkStatus();
}

/// Groups byte i of all floats: exponents compress, mantissas do not.
std::string byte_planes(const std::string& block) {
  const std::size_t words = block.size() / 4;
  std::string planes(block.size(), '\0');
  for (std::size_t i = 0; i < words; ++i) {
    for (std::size_t plane = 0; plane < 4; ++plane) {
      planes[plane * words + i] = block[4 * i + plane];
    }
  }
  for (std::size_t i = 4 * words; i < block.size(); ++i) planes[i] = block[i];
  return planes;
}

void measure_compression(const std::vector<std::string>& blocks, int level) {
  std::size_t raw = 0;
  std::size_t packed = 0;
  const double start = cpu_seconds();
  for (const std::string& block : blocks) {
    const std::string planes = byte_planes(block);
    std::string out(ZSTD_compressBound(planes.size()), '\0');
    packed += ZSTD_compress(out.data(), out.size(), planes.data(), planes.size(), level);
    raw += block.size();
  }
  const double seconds = cpu_seconds() - start;
  std::printf("zstd %2d over byte planes of %zu-byte blocks: %.3f of the size, %.0f MB/CPU s\n",
              level, blocks.front().size(), static_cast<double>(packed) / static_cast<double>(raw),
              static_cast<double>(raw) / seconds / 1e6);
}

int run(const std::string& folder) {
  struct statfs info {};
  if (statfs(folder.c_str(), &info) != 0 || info.f_type == kTmpfsMagic) {
    std::fprintf(stderr, "%s is not a folder on a real disk\n", folder.c_str());
    return 2;
  }
  std::mt19937 rng(7);
  std::vector<std::string> small(256);
  std::vector<std::string> large(32);
  for (std::string& block : small) block = noisy_block(rng, 8, 4);
  for (std::string& block : large) block = noisy_block(rng, 64, 4);
  absl::Status status;
  for (const int count : {1, 4, 16, 64, 256}) {
    if (status.ok()) status = measure(folder, small, count);
  }
  for (const int count : {1, 4, 16, 64}) {
    if (status.ok()) status = measure(folder, large, count);
  }
  for (const int level : {-5, 1, 3}) {
    measure_compression(small, level);
    measure_compression(large, level);
  }
  if (!status.ok()) std::fprintf(stderr, "%s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace tessera::server

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: store_bench FOLDER\n");
    return 2;
  }
  return tessera::server::run(argv[1]);
}
