#include "worker/guide/photon_chains.h"

#include <algorithm>
#include <utility>

#include "worker/sampling/hash.h"

namespace tessera::render {
namespace {

constexpr std::int64_t kProposalsPerChain = 256;
/// A proposal differs from the path by up to 2^-2 to 2^-5 in each random number. Smaller steps
/// bring photons so alike that a few of them look like a narrow lobe. Measured:
/// docs/notes/guiding.md.
constexpr int kFirstCloseness = 1, kClosenesses = 4;

/// A path with a wanted photon, by the random numbers that lead to it.
class Chain {
 public:
  Chain(const PhotonTracing& tracing, const PhotonStore& store, std::uint64_t path)
      : tracing_(tracing), store_(store), path_(path) {
    trace(PhotonRandom(path));
    std::swap(numbers_, proposed_);
  }

  /// Moves to a path nearby if that has a wanted photon, and then appends its wanted photons.
  void propose(std::uint64_t key, std::vector<Photon>* stored) {
    const int closeness =
        kFirstCloseness + static_cast<int>(combine(key, kClosenesses) % kClosenesses);
    trace(PhotonRandom(key, numbers_, closeness));
    const auto end = std::remove_if(photons_.begin(), photons_.end(),
                                    [this](const Photon& photon) { return !store_.wants(photon); });
    if (end == photons_.begin()) return;
    stored->insert(stored->end(), photons_.begin(), end);
    std::swap(numbers_, proposed_);
  }

 private:
  void trace(PhotonRandom random) {
    proposed_.clear();
    photons_.clear();
    random.record(&proposed_);
    PhotonPath(tracing_.scene, random, path_).trace(tracing_.source, tracing_.region, &photons_);
  }

  const PhotonTracing& tracing_;
  const PhotonStore& store_;
  std::uint64_t path_;  // where the chain starts
  std::vector<std::uint64_t> numbers_, proposed_;
  std::vector<Photon> photons_;  // of the path that was traced last
};

}  // namespace

std::vector<Photon> trace_chains(const PhotonTracing& tracing, const PhotonStore& store,
                                 const std::vector<std::uint64_t>& paths, std::uint64_t key,
                                 std::int64_t count) {
  const std::int64_t chains = (count + kProposalsPerChain - 1) / kProposalsPerChain;
  return trace_parts(
      chains, tracing.parallel_for, [&](std::int64_t i, std::vector<Photon>* stored) {
        const auto first =
            static_cast<std::size_t>(i) * paths.size() / static_cast<std::size_t>(chains);
        Chain chain(tracing, store, paths[first]);
        const std::uint64_t chain_key = combine(key, static_cast<std::uint64_t>(i));
        const std::int64_t proposals = std::min(kProposalsPerChain, count - i * kProposalsPerChain);
        for (std::int64_t k = 0; k < proposals; ++k) {
          chain.propose(combine(chain_key, static_cast<std::uint64_t>(k)), stored);
        }
      });
}

}  // namespace tessera::render
