#include "lmc/study_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace lmc {

namespace {

constexpr double kWidth = 460.0, kHeight = 400.0;                           // of a panel [px]
constexpr double kLeft = 74.0, kRight = 18.0, kTop = 62.0, kBottom = 52.0;  // margins
constexpr std::size_t kManyTicks = 9;

struct Axis {
  double low, high, from, to;  // values and places
  double at(double value) const { return from + (to - from) * std::log(value / low) / std::log(high / low); }
};

Axis axisOf(double low, double high, double from, double to) {
  if (!(low > 0.0) || !(high > 0.0)) low = 0.1, high = 1.0;
  const double room = std::max(1.25, std::pow(high / low, 0.08));  // about the points
  return {low / room, high * room, from, to};
}

std::string numberText(double v, bool percent) {
  if (percent) return fmt::format("{:.3g} %", 100.0 * v);
  if (v >= 1e9) return fmt::format("{:.3g} G", v / 1e9);
  if (v >= 1e6) return fmt::format("{:.3g} M", v / 1e6);
  if (v >= 1e4) return fmt::format("{:.3g} k", v / 1e3);
  if (v >= 1e3) return fmt::format("{:.0f}", v);
  return fmt::format("{:.3g}", v);
}

std::string text(double x, double y, const std::string& words, const char* anchor, const char* more = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\"{}>{}</text>\n", x, y, anchor, more, escapedForXml(words));
}

std::string markAt(char kind, double x, double y, const std::string& colour) {
  if (kind == 'x')
    return fmt::format("<path d=\"M{0:.1f} {1:.1f}l8 8m0 -8l-8 8\" stroke=\"{2}\" stroke-width=\"2\" fill=\"none\"/>\n", x - 4.0, y - 4.0,
                       colour);
  if (kind == 's')
    return fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"7\" height=\"7\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.6\"/>\n",
                       x - 3.5, y - 3.5, colour);
  return fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"4.2\" fill=\"{}\"/>\n", x, y, colour);
}

std::string panelOf(const Panel& p, double left) {
  double xLow = INFINITY, xHigh = 0.0, yLow = INFINITY, yHigh = 0.0;
  const auto take = [](double v, double& low, double& high) {
    if (!(v > 0.0) || !std::isfinite(v)) return;
    low = std::min(low, v);
    high = std::max(high, v);
  };
  for (const PlotSeries& s : p.series)
    for (const PlotPoint& q : s.points) {
      if (!(q.x > 0.0) || !(q.y > 0.0)) continue;
      for (const double v : {q.x, q.xLow, q.xHigh}) take(v, xLow, xHigh);
      take(q.y, yLow, yHigh);
    }
  for (const PlotMark& m : p.marks) take(m.x, xLow, xHigh);
  // A decade at least, else straight lines look steep for nothing.
  const auto widened = [](double& low, double& high) {
    if (!std::isfinite(low)) low = high = 1.0;
    if (high / low >= 4.0) return;
    const double middle = std::sqrt(low * high);
    low = middle / 2.0;
    high = middle * 2.0;
  };
  widened(xLow, xHigh);
  widened(yLow, yHigh);
  const Axis x = axisOf(xLow, xHigh, left + kLeft, left + kWidth - kRight), y = axisOf(yLow, yHigh, kHeight - kBottom, kTop);

  std::string out = text(0.5 * (x.from + x.to), 18, p.title, "middle", " font-size=\"14\" font-weight=\"bold\"");
  for (const double v : logTicks(x.low, x.high)) {
    out += fmt::format("<path d=\"M{0:.1f} {1:.1f}V{2:.1f}\" class=\"grid\"/>\n", x.at(v), y.from, y.to);
    out += text(x.at(v), y.from + 17, numberText(v, p.xPercent), "middle");
  }
  for (const double v : logTicks(y.low, y.high)) {
    out += fmt::format("<path d=\"M{0:.1f} {1:.1f}H{2:.1f}\" class=\"grid\"/>\n", x.from, y.at(v), x.to);
    out += text(x.from - 6, y.at(v) + 4, numberText(v, p.yPercent), "end");
  }
  out += fmt::format("<path d=\"M{0:.1f} {1:.1f}V{2:.1f}H{3:.1f}\" fill=\"none\" stroke=\"#333\"/>\n", x.from, y.to, y.from, x.to);
  out += text(0.5 * (x.from + x.to), kHeight - 12, p.xName, "middle");
  out += fmt::format("<text transform=\"translate({:.1f} {:.1f}) rotate(-90)\" text-anchor=\"middle\">{}</text>\n", left + 15,
                     0.5 * (y.from + y.to), escapedForXml(p.yName));
  for (const PlotMark& m : p.marks) {
    out += fmt::format("<path d=\"M{0:.1f} {1:.1f}V{2:.1f}\" stroke=\"#888\" stroke-dasharray=\"3 3\"/>\n", x.at(m.x), y.from, y.to);
    out += text(x.at(m.x), y.to - 4, m.label, "middle", " fill=\"#666\"");
  }
  double legend = left + kLeft;
  for (const PlotSeries& s : p.series) {
    std::vector<double> across;
    for (const PlotPoint& q : s.points) {
      if (!(q.x > 0.0) || !(q.y > 0.0)) continue;
      across.push_back(q.x);
      if (q.xLow > 0.0 && q.xHigh > 0.0)
        out += fmt::format("<path d=\"M{0:.1f} {2:.1f}H{1:.1f}m0 -3v6M{0:.1f} {3:.1f}v6\" stroke=\"{4}\" fill=\"none\"/>\n", x.at(q.xLow),
                           x.at(q.xHigh), y.at(q.y), y.at(q.y) - 3.0, s.colour);
      out += markAt(s.mark, x.at(q.x), y.at(q.y), s.colour);
      if (!q.label.empty()) out += text(x.at(q.x), y.at(q.y) - 9, q.label, "middle", " font-size=\"11\"");
    }
    if (s.law && across.size() > 1) {
      const double a = std::ranges::min(across), b = std::ranges::max(across);
      const auto value = [&](double v) { return std::clamp(s.law->factor * std::pow(v, s.law->exponent), y.low, y.high); };
      out += fmt::format("<path d=\"M{:.1f} {:.1f}L{:.1f} {:.1f}\" stroke=\"{}\" stroke-width=\"1.5\" fill=\"none\"/>\n", x.at(a),
                         y.at(value(a)), x.at(b), y.at(value(b)), s.colour);
    }
    const std::string words = s.law ? fmt::format("{} (exponent {:.2f})", s.name, s.law->exponent) : s.name;
    out += markAt(s.mark, legend + 5, 33, s.colour);
    out += text(legend + 14, 37, words, "start");
    legend += 26.0 + 6.4 * double(words.size());
  }
  return out;
}

}  // namespace

std::vector<double> logTicks(double low, double high) {
  std::vector<double> out;
  for (int decade = int(std::floor(std::log10(low))); decade <= int(std::ceil(std::log10(high))); ++decade)
    for (const double digit : {1.0, 2.0, 5.0})
      if (const double v = digit * std::pow(10.0, decade); v >= low * 0.999 && v <= high * 1.001) out.push_back(v);
  if (out.size() <= kManyTicks) return out;
  std::vector<double> decades;
  for (const double v : out)
    if (std::abs(std::log10(v) - std::round(std::log10(v))) < 1e-6) decades.push_back(v);
  return decades;
}

std::string escapedForXml(const std::string& words) {
  std::string out;
  for (const char c : words) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else if (std::uint8_t(c) < 0x20)
      out += ' ';
    else
      out += c;
  }
  return out;
}

std::string svgOf(const std::vector<Panel>& panels) {
  const double width = kWidth * double(panels.size());
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:.0f} {1:.0f}\" width=\"{0:.0f}\" height=\"{1:.0f}\" "
      "font-family=\"sans-serif\" font-size=\"12\" fill=\"#222\">\n<style>.grid{{stroke:#ddd;fill:none}}</style>\n"
      "<rect width=\"{0:.0f}\" height=\"{1:.0f}\" fill=\"#fff\"/>\n",
      width, kHeight);
  for (std::size_t k = 0; k < panels.size(); ++k) out += panelOf(panels[k], kWidth * double(k));
  return out + "</svg>\n";
}

}  // namespace lmc
