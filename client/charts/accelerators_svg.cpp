#include "client/charts/accelerators_svg.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/charts/log_plot.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

constexpr double kSvgWidth = 1080, kSvgHeight = 500, kAreaTop = 44, kAreaBottom = 442;
constexpr PlotArea kTimeArea = {84, kAreaTop, 530, kAreaBottom},
                   kVisitsArea = {624, kAreaTop, 1070, kAreaBottom};

/// A structure in a panel; coordinates are decades.
struct Mark {
  std::string name;
  double x = 0, y = 0;
};

double number(const ordered_json& object, const char* key) {
  const auto found = object.find(key);
  return found != object.end() && found->is_number() ? found->get<double>() : 0;
}

/// Returns the mean over all rays of a cost that queries have; nullopt if it is unknown.
template <typename Cost>
std::optional<double> mean_cost(const ordered_json& row, const ordered_json& rays,
                                const Cost& cost) {
  const std::pair<const char*, double> queries[] = {
      {"closest_hit", number(rays, "camera") + number(rays, "bounce")},
      {"any_hit", number(rays, "shadow")}};
  double sum = 0, total = 0;
  for (const auto& [query, count] : queries) {
    if (!(count > 0)) continue;
    const std::optional<double> each = cost(row.value(query, ordered_json::object()));
    if (!each) return std::nullopt;
    sum += count * *each;
    total += count;
  }
  return total > 0 ? std::optional(sum / total) : std::nullopt;
}

std::optional<double> microseconds(const ordered_json& query) {
  const double mrays = number(query, "mrays_per_second");
  return mrays > 0 ? std::optional(1 / mrays) : std::nullopt;
}

std::optional<double> visits(const ordered_json& query) {
  const auto nodes = query.find("nodes_per_ray"), primitives = query.find("triangles_per_ray");
  if (nodes == query.end() || !nodes->is_number()) return std::nullopt;
  if (primitives == query.end() || !primitives->is_number()) return std::nullopt;
  return nodes->get<double>() + primitives->get<double>();
}

/// Returns the structures that have both values, which must be positive.
template <typename Cost>
std::vector<Mark> marks_of(const ordered_json& accelerators, const char* x_key, double x_unit,
                           const Cost& cost) {
  std::vector<Mark> marks;
  const ordered_json rays = accelerators.value("rays", ordered_json::object());
  for (const ordered_json& row : accelerators.value("structures", ordered_json::array())) {
    const double x = number(row, x_key) / x_unit;
    const std::optional<double> y = mean_cost(row, rays, cost);
    if (!(x > 0) || !y || !(*y > 0)) continue;
    marks.push_back({row.value("name", ""), std::log10(x), std::log10(*y)});
  }
  return marks;
}

/// A rectangle that a label or mark covers.
struct Box {
  double left, top, right, bottom;
  bool overlaps(const Box& other) const {
    return left < other.right && other.left < right && top < other.bottom && other.top < bottom;
  }
  bool inside(const PlotArea& area) const {
    return left >= area.left && right <= area.right && top >= area.top && bottom <= area.bottom;
  }
};

/// Places labels beside their marks, each in the nearest free place, so that none covers another or
/// a mark.
class Labels {
 public:
  Labels(const PlotArea& area, LogPlot& plot) : area_(area), plot_(plot) {}

  void reserve(double x, double y) { taken_.push_back({x - 4, y - 4, x + 4, y + 4}); }

  void place(double x, double y, const std::string& words) {
    constexpr double kLetter = 6.6, kAscent = 10, kDescent = 3;
    const double width = kLetter * static_cast<double>(words.size());
    constexpr std::array<std::array<double, 2>, 8> kDirections = {
        {{1, 0}, {-1, 0}, {0.7, -0.7}, {-0.7, -0.7}, {0.7, 0.7}, {-0.7, 0.7}, {0, -1}, {0, 1}}};
    for (int ring = 0; ring < 32; ++ring) {
      const double distance = 9 + 6 * ring;
      for (const auto& [dx, dy] : kDirections) {
        const double left = x + dx * distance + (dx < 0 ? -width : dx > 0 ? 0 : -width / 2);
        const double baseline = y + dy * distance + 4;
        const Box box = {left, baseline - kAscent, left + width, baseline + kDescent};
        const auto covers = [&](const Box& other) { return box.overlaps(other); };
        if (!box.inside(area_) || std::any_of(taken_.begin(), taken_.end(), covers)) continue;
        taken_.push_back(box);
        if (ring > 0) {
          const double to_x = std::clamp(x, box.left, box.right);
          const double to_y = std::clamp(y, box.top, box.bottom);
          plot_.rule(x, y, to_x, to_y, "leader");
        }
        plot_.text(left, baseline, "start", words);
        return;
      }
    }
  }

 private:
  PlotArea area_;
  LogPlot& plot_;
  std::vector<Box> taken_;
};

std::string panel(const PlotArea& area, const std::string& title, const std::string& x_label,
                  const std::string& y_label, const std::vector<Mark>& marks) {
  DecadeRange x, y;
  for (const Mark& mark : marks) {
    x.add(mark.x);
    y.add(mark.y);
  }
  if (x.empty()) return "";
  LogPlot plot(area, x.padded(), y.padded());
  plot.text(area.left, area.top - 16, "start", title);
  plot.axes(x_label, y_label);
  Labels labels(area, plot);
  for (const Mark& mark : marks) {
    const double at_x = plot.at_x(mark.x), at_y = plot.at_y(mark.y);
    plot.circle(at_x, at_y, absl::StartsWith(mark.name, "wide-bvh") ? "production" : "other");
    labels.reserve(at_x, at_y);
  }
  for (const Mark& mark : marks) labels.place(plot.at_x(mark.x), plot.at_y(mark.y), mark.name);
  return plot.body();
}

constexpr char kStyle[] = R"(<style>
text{font:12px sans-serif;fill:#222}.grid{stroke:#ddd}.leader{stroke:#999}
.production{fill:#c2410c}.other{fill:#0b62a8}
@media(prefers-color-scheme:dark){text{fill:#ddd}.grid{stroke:#444}.leader{stroke:#777}
.production{fill:#fb923c}.other{fill:#6db3f2}}
</style>
)";

}  // namespace

absl::StatusOr<std::string> accelerators_svg(const ordered_json& accelerators) {
  constexpr double kMiB = 1 << 20;
  const std::string time =
      panel(kTimeArea, "Time (orange: production)", "build time, CPU seconds",
            "CPU time per ray, µs", marks_of(accelerators, "build_seconds", 1, microseconds));
  const std::string work =
      panel(kVisitsArea, "Visits", "memory, MiB", "nodes visited and triangles tested per ray",
            marks_of(accelerators, "memory_bytes", kMiB, visits));
  if (time.empty()) {
    return absl::FailedPreconditionError(
        "no measurements to plot: the scene gives no rays or cannot be rendered");
  }
  return absl::StrCat(
      absl::StrFormat("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\">\n",
                      kSvgWidth, kSvgHeight),
      kStyle, time, work, "</svg>\n");
}

}  // namespace tessera::client
