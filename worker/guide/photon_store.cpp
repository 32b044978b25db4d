#include "worker/guide/photon_store.h"

#include <algorithm>

namespace tessera::render {
namespace {

/// Measured: docs/notes/guiding.md.
constexpr std::uint32_t kEnoughInCell = 512, kMaxInCell = 1024;
constexpr std::int64_t kPhotonsPerPixel = 48, kMinPhotonCount = 1 << 16, kMaxPhotonCount = 1 << 19;

}  // namespace

PhotonStore::PhotonStore(const VisibleRegion& region, std::int64_t pixels)
    : region_(region),
      enough_(static_cast<std::size_t>(
          std::clamp(kPhotonsPerPixel * pixels, kMinPhotonCount, kMaxPhotonCount))),
      counts_(VisibleRegion::kCells + 1),
      found_(VisibleRegion::kCells + 1),
      guided_(VisibleRegion::kCells + 1) {}

std::size_t PhotonStore::cell_of(const Photon& photon) const {
  return region_.cell({photon.position, photon.normal});
}

void PhotonStore::keep(const Photon& photon) {
  if (!region_.is_all() && counts_[cell_of(photon)]++ >= kMaxInCell) return;
  photons_.push_back(photon);
}

void PhotonStore::add(const std::vector<Photon>& photons) {
  for (const Photon& photon : photons) {
    const bool is_found = photon.share == 0;
    if (!region_.is_all()) (is_found ? found_ : guided_)[cell_of(photon)] += double{photon.flux};
    if (is_found) continue;
    if (wants(photon)) independent_.push_back({photon.path, cell_of(photon)});
    keep(photon);
  }
}

void PhotonStore::add_of_chains(const std::vector<Photon>& photons) {
  for (const Photon& photon : photons) keep(photon);
}

bool PhotonStore::wants(const Photon& photon) const {
  return photon.share > 0 && (region_.is_all() || counts_[cell_of(photon)] < kMaxInCell);
}

std::vector<std::uint64_t> PhotonStore::wanted_paths() const {
  std::vector<std::uint64_t> paths;
  for (const Arrival& arrival : independent_) {
    const bool is_new = paths.empty() || paths.back() != arrival.path;
    if (is_new && counts_[arrival.cell] < kMaxInCell) paths.push_back(arrival.path);
  }
  return paths;
}

double PhotonStore::share_of_seen(std::uint32_t least) const {
  const auto seen = region_.seen_cells();
  const auto reached = std::count_if(seen.begin(), seen.end(),
                                     [&](std::uint32_t cell) { return counts_[cell] >= least; });
  return seen.empty() ? 1 : static_cast<double>(reached) / static_cast<double>(seen.size());
}

bool PhotonStore::is_enough() const {
  if (photons_.size() >= enough_) return true;
  return !photons_.empty() && share_of_seen(kEnoughInCell) >= 0.5;
}

std::vector<Photon> PhotonStore::photons() const {
  std::vector<Photon> all = photons_;
  if (region_.is_all()) return all;
  for (Photon& photon : all) {
    const std::size_t cell = cell_of(photon);
    const double flux = guided_[cell] + found_[cell];
    photon.share = flux > 0 ? static_cast<float>(guided_[cell] / flux) : 1;
  }
  return all;
}

}  // namespace tessera::render
