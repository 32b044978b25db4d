#include "client/charts/curve_svg.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

constexpr double kWidth = 720, kHeight = 440, kLeft = 78, kRight = 20, kTop = 46, kBottom = 58;

struct Point {
  double x, y;  // log10 of CPU seconds and error
};

/// Range of an axis in decades.
struct Range {
  double low = std::numeric_limits<double>::max(), high = std::numeric_limits<double>::lowest();
  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  /// Returns the range with padding, at least half a decade wide.
  Range padded() const {
    const double pad = std::max(0.08 * (high - low), (0.5 - (high - low)) / 2);
    return {low - pad, high + pad};
  }
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

/// The plot area and the mapping of decades to it.
class Plot {
 public:
  Plot(const Range& x, const Range& y) : x_(x), y_(y) {}

  double at_x(double decade) const {
    return kLeft + (decade - x_.low) / (x_.high - x_.low) * (kWidth - kLeft - kRight);
  }
  double at_y(double decade) const {
    return kHeight - kBottom - (decade - y_.low) / (y_.high - y_.low) * (kHeight - kTop - kBottom);
  }

  void line(const std::vector<Point>& points, const char* style) {
    if (points.empty()) return;
    absl::StrAppend(&body_, "<polyline class=\"", style, "\" points=\"");
    for (const Point& p : points) {
      absl::StrAppend(&body_, absl::StrFormat("%.1f,%.1f ", at_x(p.x), at_y(p.y)));
    }
    absl::StrAppend(&body_, "\"/>\n");
    for (const Point& p : points) {
      absl::StrAppend(
          &body_, absl::StrFormat("<circle class=\"%s\" cx=\"%.1f\" cy=\"%.1f\" r=\"3\"/>\n", style,
                                  at_x(p.x), at_y(p.y)));
    }
  }
  void text(double x, double y, const char* anchor, const std::string& words) {
    absl::StrAppend(
        &body_, absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">", x, y, anchor),
        words, "</text>\n");
  }

  /// Draws the axes with ticks at 1, 2 and 5 of each decade.
  void axes() {
    for (const double tick : ticks(x_)) {
      rule(at_x(tick), kTop, at_x(tick), kHeight - kBottom, "grid");
      text(at_x(tick), kHeight - kBottom + 18, "middle", absl::StrFormat("%g", std::pow(10, tick)));
    }
    for (const double tick : ticks(y_)) {
      rule(kLeft, at_y(tick), kWidth - kRight, at_y(tick), "grid");
      text(kLeft - 8, at_y(tick) + 4, "end", absl::StrFormat("%g", std::pow(10, tick)));
    }
    text((kLeft + kWidth - kRight) / 2, kHeight - 14, "middle", "CPU seconds");
    absl::StrAppend(&body_, absl::StrFormat("<text transform=\"translate(18,%.0f) rotate(-90)\" "
                                            "text-anchor=\"middle\">error</text>\n",
                                            (kTop + kHeight - kBottom) / 2));
  }
  /// Draws lines along which four times the work halves the error, clipped to the plot.
  void guides() {
    const double first = std::floor(y_.low);
    const auto count = static_cast<int>(2 * (y_.high + x_.high - x_.low - first)) + 1;
    for (int i = 0; i < count; ++i) {
      const double level = first + 0.5 * i;
      const double from = std::max(x_.low, x_.low + 2 * (level - y_.high));
      const double to = std::min(x_.high, x_.low + 2 * (level - y_.low));
      if (from >= to) continue;
      const auto height = [&](double x) { return level - (x - x_.low) / 2; };
      rule(at_x(from), at_y(height(from)), at_x(to), at_y(height(to)), "guide");
    }
  }
  const std::string& body() const { return body_; }

 private:
  static std::vector<double> ticks(const Range& range) {
    std::vector<double> found;
    const bool many = range.high - range.low > 3;
    for (int decade = static_cast<int>(std::floor(range.low)); decade <= range.high; ++decade) {
      for (const double step : {1.0, 2.0, 5.0}) {
        const double tick = decade + std::log10(step);
        if (many && step != 1) continue;
        if (tick >= range.low && tick <= range.high) found.push_back(tick);
      }
    }
    return found;
  }
  void rule(double x1, double y1, double x2, double y2, const char* style) {
    absl::StrAppend(&body_, absl::StrFormat("<line class=\"%s\" x1=\"%.1f\" y1=\"%.1f\" "
                                            "x2=\"%.1f\" y2=\"%.1f\"/>\n",
                                            style, x1, y1, x2, y2));
  }

  Range x_, y_;
  std::string body_;
};

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
  Range x, y;
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
  if (x.low > x.high) return "";
  Plot plot(x.padded(), y.padded());
  plot.axes();
  plot.guides();
  bool has_truth = false;
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    plot.line(estimates[i], "estimate");
    plot.line(truths[i], "true");
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
