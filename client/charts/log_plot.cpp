#include "client/charts/log_plot.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace tessera::client {

void DecadeRange::add(double decade) {
  low = std::min(low, decade);
  high = std::max(high, decade);
}

DecadeRange DecadeRange::padded() const {
  const double pad = std::max(0.08 * (high - low), (0.5 - (high - low)) / 2);
  return {low - pad, high + pad};
}

double LogPlot::at_x(double decade) const {
  return area_.left + (decade - x_.low) / (x_.high - x_.low) * (area_.right - area_.left);
}

double LogPlot::at_y(double decade) const {
  return area_.bottom - (decade - y_.low) / (y_.high - y_.low) * (area_.bottom - area_.top);
}

void LogPlot::axes(const std::string& x_label, const std::string& y_label) {
  for (const double tick : ticks(x_)) {
    rule(at_x(tick), area_.top, at_x(tick), area_.bottom, "grid");
    text(at_x(tick), area_.bottom + 18, "middle", absl::StrFormat("%g", std::pow(10, tick)));
  }
  for (const double tick : ticks(y_)) {
    rule(area_.left, at_y(tick), area_.right, at_y(tick), "grid");
    text(area_.left - 8, at_y(tick) + 4, "end", absl::StrFormat("%g", std::pow(10, tick)));
  }
  text((area_.left + area_.right) / 2, area_.bottom + 44, "middle", x_label);
  absl::StrAppend(&body_,
                  absl::StrFormat("<text transform=\"translate(%.0f,%.0f) rotate(-90)\" "
                                  "text-anchor=\"middle\">",
                                  area_.left - 60, (area_.top + area_.bottom) / 2),
                  y_label, "</text>\n");
}

void LogPlot::rule(double x1, double y1, double x2, double y2, const char* style) {
  absl::StrAppend(&body_, absl::StrFormat("<line class=\"%s\" x1=\"%.1f\" y1=\"%.1f\" "
                                          "x2=\"%.1f\" y2=\"%.1f\"/>\n",
                                          style, x1, y1, x2, y2));
}

void LogPlot::circle(double x, double y, const char* style) {
  absl::StrAppend(
      &body_,
      absl::StrFormat("<circle class=\"%s\" cx=\"%.1f\" cy=\"%.1f\" r=\"3\"/>\n", style, x, y));
}

void LogPlot::text(double x, double y, const char* anchor, const std::string& words) {
  absl::StrAppend(&body_,
                  absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\">", x, y, anchor),
                  words, "</text>\n");
}

std::vector<double> LogPlot::ticks(const DecadeRange& range) {
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

}  // namespace tessera::client
