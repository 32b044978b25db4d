#pragma once

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "tessera/v1/render_settings.pb.h"

namespace tessera::contract {

/// Converts a rectangle to a message.
v1::PixelRect to_message(const PixelRect& rect);

/// Converts settings to a message.
v1::RenderSettings to_message(const RenderSettings& settings);

/// Converts settings from a message and checks every range.
///
/// Errors: InvalidArgument, "settings.FIELD: value, range".
absl::StatusOr<RenderSettings> from_message(const v1::RenderSettings& message);

/// Returns the Aov bits of layer names. Errors: InvalidArgument, an unknown or repeated name.
absl::StatusOr<std::uint32_t> parse_aovs(const std::vector<std::string>& names);

/// Returns the names of the layers in `aovs`, in bit order.
std::vector<std::string> aov_names(std::uint32_t aovs);

}  // namespace tessera::contract
