#pragma once

#include <limits>
#include <string>
#include <vector>

namespace tessera::client {

/// Range of a logarithmic axis, in decades.
struct DecadeRange {
  double low = std::numeric_limits<double>::max(), high = std::numeric_limits<double>::lowest();

  void add(double decade);
  bool empty() const { return low > high; }
  /// Returns the range with padding, at least half a decade wide.
  DecadeRange padded() const;
};

/// Rectangle of an SVG image, in its units.
struct PlotArea {
  double left = 0, top = 0, right = 0, bottom = 0;
};

/// The body of an SVG plot with two logarithmic axes. Coordinates of data are decades: log10 of the
/// value.
class LogPlot {
 public:
  /// The ranges must not be empty.
  LogPlot(const PlotArea& area, const DecadeRange& x, const DecadeRange& y)
      : area_(area), x_(x), y_(y) {}

  const DecadeRange& x_range() const { return x_; }
  const DecadeRange& y_range() const { return y_; }
  double at_x(double decade) const;
  double at_y(double decade) const;

  /// Draws the axes with ticks at 1, 2 and 5 of each decade, or at 1 if there are many.
  void axes(const std::string& x_label, const std::string& y_label);
  /// Draw in SVG units. `style` is a CSS class, `anchor` start, middle or end.
  void rule(double x1, double y1, double x2, double y2, const char* style);
  void circle(double x, double y, const char* style);
  void text(double x, double y, const char* anchor, const std::string& words);
  /// Appends SVG elements.
  void append(const std::string& elements) { body_ += elements; }

  const std::string& body() const { return body_; }

 private:
  static std::vector<double> ticks(const DecadeRange& range);

  PlotArea area_;
  DecadeRange x_, y_;
  std::string body_;
};

}  // namespace tessera::client
