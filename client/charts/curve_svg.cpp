#include "client/charts/curve_svg.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/charts/log_plot.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

constexpr double kWidth = 720, kHeight = 440, kLeft = 78, kRight = 20, kTop = 46, kBottom = 58;

struct Point {
  double x, y;  // log10 of CPU seconds and error
};

std::vector<Point> points_of(const ordered_json& frame, const char* key) {
  std::vector<Point> points;
  for (const ordered_json& point : frame.value("curve", ordered_json::array())) {
    const auto error = point.find(key);
    const double seconds = point.value("cpu_seconds", 0.0);
    if (error == point.end() || !error->is_number() || seconds <= 0) continue;
    const double value = error->get<double>();
    if (value > 0) points.push_back({std::log10(seconds), std::log10(value)});
  }
  return points;
}

void draw_line(const std::vector<Point>& points, const char* style, LogPlot& plot) {
  if (points.empty()) return;
  std::string line = absl::StrCat("<polyline class=\"", style, "\" points=\"");
  for (const Point& p : points) {
    absl::StrAppend(&line, absl::StrFormat("%.1f,%.1f ", plot.at_x(p.x), plot.at_y(p.y)));
  }
  plot.append(line + "\"/>\n");
  for (const Point& p : points) plot.circle(plot.at_x(p.x), plot.at_y(p.y), style);
}

/// Draws lines along which four times the work halves the error, clipped to the plot.
void draw_guides(LogPlot& plot) {
  const DecadeRange &x = plot.x_range(), &y = plot.y_range();
  const double first = std::floor(y.low);
  const auto count = static_cast<int>(2 * (y.high + x.high - x.low - first)) + 1;
  for (int i = 0; i < count; ++i) {
    const double level = first + 0.5 * i;
    const double from = std::max(x.low, x.low + 2 * (level - y.high));
    const double to = std::min(x.high, x.low + 2 * (level - y.low));
    if (from >= to) continue;
    const auto height = [&](double at) { return level - (at - x.low) / 2; };
    plot.rule(plot.at_x(from), plot.at_y(height(from)), plot.at_x(to), plot.at_y(height(to)),
              "guide");
  }
}

constexpr char kCurveStyle[] = R"(<style>
text{font:13px sans-serif;fill:#333}.grid{stroke:#ddd}.guide{stroke:#bbb;stroke-dasharray:2 5}
polyline{fill:none;stroke-width:2}.estimate{stroke:#0b62a8}circle.estimate{fill:#0b62a8}
.true{stroke:#c2410c}circle.true{fill:#c2410c}
@media(prefers-color-scheme:dark){text{fill:#ddd}.grid{stroke:#444}.guide{stroke:#666}
.estimate{stroke:#6db3f2}circle.estimate{fill:#6db3f2}.true{stroke:#fb923c}circle.true{fill:#fb923c}}
</style>
)";

}  // namespace

std::string curve_svg(const ordered_json& report) {
  std::vector<std::vector<Point>> estimates, truths;
  DecadeRange x, y;
  for (const ordered_json& frame : report.value("frames", ordered_json::array())) {
    estimates.push_back(points_of(frame, "error"));
    truths.push_back(points_of(frame, "error_true"));
    for (const auto* points : {&estimates.back(), &truths.back()}) {
      for (const Point& point : *points) {
        x.add(point.x);
        y.add(point.y);
      }
    }
  }
  if (x.empty()) return "";
  LogPlot plot({kLeft, kTop, kWidth - kRight, kHeight - kBottom}, x.padded(), y.padded());
  plot.axes("CPU seconds", "error");
  draw_guides(plot);
  bool has_truth = false;
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    draw_line(estimates[i], "estimate", plot);
    draw_line(truths[i], "true", plot);
    has_truth = has_truth || !truths[i].empty();
  }
  plot.text(kLeft, 18, "start",
            absl::StrCat("job ", report.value("job", ""), ", ", report.value("status", "")));
  plot.text(kLeft, 36, "start",
            absl::StrCat("estimated error", has_truth ? " (blue), true error (orange)" : "",
                         "; dotted lines: four times the work, half the error"));
  return absl::StrCat(
      absl::StrFormat("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\">\n",
                      kWidth, kHeight),
      kCurveStyle, plot.body(), "</svg>\n");
}

}  // namespace tessera::client
