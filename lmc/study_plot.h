#pragma once
/// Curves of a study as SVG, by hand: log-log axes, points with bars, fitted lines.
#include <optional>
#include <string>
#include <vector>

#include "lmc/fits.h"

namespace lmc {

struct PlotPoint {
  double x = 0.0, y = 0.0;
  double xLow = 0.0, xHigh = 0.0;  ///< a bar along x; 0 = none
  std::string label;               ///< beside it; may be empty
};
struct PlotSeries {
  std::string name, colour;
  char mark = 'o';  ///< o circle, x cross, s square
  std::vector<PlotPoint> points;
  std::optional<PowerLaw> law;  ///< drawn as a line over the points' extent
};
struct PlotMark {
  double x = 0.0;
  std::string label;
};
struct Panel {
  std::string title, xName, yName;
  bool xPercent = true, yPercent = false;
  std::vector<PlotSeries> series;
  std::vector<PlotMark> marks;  ///< vertical lines
};

/// Places of a logarithmic axis that spans [low, high], at 1, 2 and 5 of each decade; fewer where that would be many.
std::vector<double> logTicks(double low, double high);

/// Panels side by side; a whole SVG file. Text that is not fit for XML is escaped.
std::string svgOf(const std::vector<Panel>&);

std::string escapedForXml(const std::string&);

}  // namespace lmc
