#pragma once

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "tessera/v1/render_settings.pb.h"

namespace tessera::contract {

/// A rectangle as a message.
v1::PixelRect to_message(const PixelRect& rect);

/// The settings as a message.
v1::RenderSettings to_message(const RenderSettings& settings);

/// The settings in a message, every range checked.
///
/// Errors: InvalidArgument, "settings.FIELD: value, range".
absl::StatusOr<RenderSettings> from_message(const v1::RenderSettings& message);

/// Aov bits of layer names. Errors: InvalidArgument naming an unknown or repeated one.
absl::StatusOr<std::uint32_t> parse_aovs(const std::vector<std::string>& names);

/// Names of the layers in `aovs`, in bit order.
std::vector<std::string> aov_names(std::uint32_t aovs);

}  // namespace tessera::contract
