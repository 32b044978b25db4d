#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "worker/guide/photon.h"
#include "worker/guide/visible_region.h"

namespace tessera::render {

/// The photons that may guide, at most kMaxInCell in a cell of the region, so that bright places
/// leave room for others.
class PhotonStore {
 public:
  /// `region` must outlive the store. `pixels`: number of pixels of the frame, which limits
  /// that of photons.
  PhotonStore(const VisibleRegion& region, std::int64_t pixels);

  /// Adds photons of independent paths. Those that light sampling finds are not kept; their flux
  /// only enters Photon::share.
  void add(const std::vector<Photon>& photons);

  /// Adds photons of chains (photon_chains.h), whose number says nothing about the flux.
  void add_of_chains(const std::vector<Photon>& photons);

  /// Whether the photon may guide and its cell is not full.
  bool wants(const Photon& photon) const;

  /// Keys of the independent paths with a photon in a cell that is not full, each once, in the
  /// order in which they were added.
  std::vector<std::uint64_t> wanted_paths() const;

  /// Share of the cells that are seen to which at least `least` photons came.
  double share_of_seen(std::uint32_t least) const;

  /// Whether half of the cells that are seen have enough photons, or there are enough in all.
  bool is_enough() const;

  /// The photons that may guide, with their shares.
  std::vector<Photon> photons() const;

 private:
  /// Where a photon of an independent path arrived that may guide.
  struct Arrival {
    std::uint64_t path;
    std::size_t cell;
  };

  std::size_t cell_of(const Photon& photon) const;
  void keep(const Photon& photon);

  const VisibleRegion& region_;
  std::size_t enough_;                  // photons in all
  std::vector<std::uint32_t> counts_;   // of photons that may guide, by cell of the region
  std::vector<double> found_, guided_;  // flux that light sampling finds, and other flux, by cell
  std::vector<Photon> photons_;
  std::vector<Arrival> independent_;
};

}  // namespace tessera::render
