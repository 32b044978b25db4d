#include "client/charts/tile_svg.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "contract/tile_grid.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

constexpr double kMapSide = 400, kMargin = 16, kHeading = 28;  // the longer side of a map

/// Colour scale, sRGB. Lightness increases, so that values remain distinct in greyscale.
constexpr std::array<std::array<int, 3>, 5> kStops = {
    {{68, 1, 84}, {59, 82, 139}, {33, 145, 140}, {94, 201, 98}, {253, 231, 37}}};

/// Returns the colour of `share` in [0, 1].
std::string colour(double share) {
  const double place = std::clamp(share, 0.0, 1.0) * (kStops.size() - 1);
  const std::size_t stop = std::min(static_cast<std::size_t>(place), kStops.size() - 2);
  const double rest = place - static_cast<double>(stop);
  std::array<int, 3> mixed{};
  for (std::size_t c = 0; c < mixed.size(); ++c) {
    mixed[c] = static_cast<int>(
        std::lround(kStops[stop][c] + rest * (kStops[stop + 1][c] - kStops[stop][c])));
  }
  return absl::StrFormat("#%02x%02x%02x", mixed[0], mixed[1], mixed[2]);
}

/// Returns the tile grid of a frame's window.
contract::TileGrid grid_of(const ordered_json& settings) {
  contract::PixelRect window{0, 0, settings.value("width", 1), settings.value("height", 1)};
  const auto crop = settings.find("crop");
  if (crop != settings.end() && crop->is_array() && crop->size() == 4) {
    window = {(*crop)[0], (*crop)[1], (*crop)[2], (*crop)[3]};
  }
  return contract::TileGrid(window, settings.value("tile", 1));
}

/// A map with a value per tile. `scale`: SVG units per pixel.
struct Map {
  std::string name;
  std::vector<double> values;
  double left, top, scale;
};

/// Draws a map. Colours follow the logarithm between minimum and maximum; tiles of 0 are hatched.
void draw(const Map& map, const contract::TileGrid& grid, std::string& svg) {
  double low = 0, high = 0;  // of positive values
  bool has_zero = false;
  for (const double value : map.values) {
    has_zero = has_zero || !(value > 0);
    if (!(value > 0)) continue;
    low = low > 0 ? std::min(low, value) : value;
    high = std::max(high, value);
  }
  const std::string range = high > 0 ? absl::StrFormat("%.3g to %.3g", low, high) : "";
  absl::StrAppend(&svg, absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\">", map.left, map.top - 8),
                  map.name, ": ", range, has_zero && high > 0 ? ", " : "",
                  has_zero ? "0 hatched" : "", "</text>\n");
  for (std::int32_t tile = 0; tile < grid.tile_count(); ++tile) {
    const contract::PixelRect rect = grid.rect(tile);
    const double value = map.values[static_cast<std::size_t>(tile)];
    const double share = high > low ? std::log(value / low) / std::log(high / low) : 0;
    absl::StrAppend(
        &svg, absl::StrFormat(
                  "<rect x=\"%.2f\" y=\"%.2f\" width=\"%.2f\" height=\"%.2f\" fill=\"%s\">"
                  "<title>tile %d: %.4g</title></rect>\n",
                  map.left + map.scale * (rect.x - grid.window().x),
                  map.top + map.scale * (rect.y - grid.window().y), map.scale * rect.width,
                  map.scale * rect.height, value > 0 ? colour(share) : "url(#zero)", tile, value));
  }
}

constexpr char kTileStyle[] = R"svg(<style>
text{font:13px sans-serif;fill:#333}rect{shape-rendering:crispEdges}
@media(prefers-color-scheme:dark){text{fill:#ddd}}
</style>
<defs><pattern id="zero" width="6" height="6" patternUnits="userSpaceOnUse"
 patternTransform="rotate(45)"><path d="M3 0V6" stroke="#888" stroke-width="1.5"/></pattern></defs>
)svg";

}  // namespace

absl::StatusOr<std::string> tile_svg(const ordered_json& report) {
  const contract::TileGrid grid = grid_of(report.value("settings", ordered_json::object()));
  const auto tiles = static_cast<std::size_t>(grid.tile_count());
  const contract::PixelRect& window = grid.window();
  const double scale = kMapSide / std::max(window.width, window.height);
  std::string body;
  double top = kHeading;
  for (const ordered_json& frame : report.value("frames", ordered_json::array())) {
    const auto figures = frame.find("tiles");
    if (figures == frame.end() || !figures->is_object()) continue;
    const auto errors = figures->value("error", std::vector<double>());
    const auto samples = figures->value("spp", std::vector<double>());
    if (errors.size() != tiles || samples.size() != tiles) continue;
    const std::string label = absl::StrCat("frame ", frame.value("frame", 0), ", error");
    draw({label, errors, kMargin, top, scale}, grid, body);
    draw({"samples per pixel", samples, 2 * kMargin + kMapSide, top, scale}, grid, body);
    top += scale * window.height + kMargin + kHeading;
  }
  if (body.empty()) {
    return absl::FailedPreconditionError(
        "no frame has tile statistics: none is finished, the first pass is black, or there are "
        "more "
        "than 16,384 tiles (use a larger --tile-size)");
  }
  return absl::StrCat(
      absl::StrFormat("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\">\n",
                      3 * kMargin + 2 * kMapSide, top - kHeading),
      kTileStyle, body, "</svg>\n");
}

}  // namespace tessera::client
