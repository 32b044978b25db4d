#pragma once

#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "server/coordinator/coordinator.h"
#include "tessera/v1/farm_service.pb.h"
#include "tessera/v1/job_service.pb.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::server {

// Converts messages to and from the coordinator's plain structs. All external input is checked
// here: ranges, lengths, digests. Errors: InvalidArgument, "field: value, requirement".

/// Maximum number of missing tiles in a message, 20 bytes each.
inline constexpr std::size_t kTilesPerMessage = 65'536;

v1::Limit to_message(const LimitView& limit);
v1::ClientShare to_message(const ShareView& share);
v1::Event to_message(const Event& event);
v1::Delivery to_message(const Delivery& delivery);
/// `silence_seconds`: since the worker's last message; none if it has sent none.
v1::Worker to_message(const Worker& worker, std::optional<double> silence_seconds);
v1::UnitId to_message(const UnitName& name);
v1::Lease to_message(const Lease& lease);
v1::Acknowledgement to_message(const Acknowledgement& acknowledgement);
/// Lists at most kTilesPerMessage missing tiles.
v1::FrameHeader to_message(const FrameFile& file);
/// Lists the missing tiles from index `first`, at most kTilesPerMessage.
v1::MissingTiles missing_tiles_from(const FrameFile& file, std::size_t first);

UnitName from_message(const v1::UnitId& message);
/// Converts a lease without checking its seal.
Lease from_message(const v1::Lease& message);
absl::StatusOr<Hello> from_message(const v1::WorkerHello& message);
absl::StatusOr<BlockHeader> from_message(const v1::BlockHeader& message);
absl::StatusOr<FrameQuery> from_message(const v1::FetchFrameRequest& message);

}  // namespace tessera::server
