#pragma once

#include <cstdint>
#include <vector>

#include "worker/guide/photon_path.h"
#include "worker/guide/photon_store.h"

namespace tessera::render {

/// Traces photons near useful paths, where few independent paths are useful: Metropolis sampling of
/// the random numbers of photons, by which all paths with a wanted photon are equally likely.
/// Source: Hachisuka & Jensen, "Robust adaptive photon tracing using photon path visibility", 2011.
///
/// Proposes `count` paths in chains, each of which starts from one of `paths`, of which there is at
/// least one. Returns the wanted photons of the accepted proposals, in the order of the chains. The
/// photons of a path on which a chain stays are not repeated: the guide only has to be similar to
/// the light. The result does not depend on the number of threads.
std::vector<Photon> trace_chains(const PhotonTracing& tracing, const PhotonStore& store,
                                 const std::vector<std::uint64_t>& paths, std::uint64_t key,
                                 std::int64_t count);

}  // namespace tessera::render
