#include "lmc/study_page.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "libscene/exr.h"
#include "libscene/image_file.h"
#include "lmc/study_plot.h"

namespace lmc {

namespace {

using Json = nlohmann::ordered_json;
using Picture = Image<glm::u8vec4>;

constexpr int kSide = 320;                               // of a picture at most [pixels]
constexpr double kLeastShown = 0.001, kMostShown = 0.3;  // errors, against the level's mean

/// A map of a file as three channels, scale taken in, and where it is covered.
struct Plane {
  int width = 0, height = 0;
  std::vector<glm::vec3> value;
  std::vector<std::uint8_t> there;
};

/// `layer`: "" or "stderr."; nothing where the file lacks it.
Plane planeOf(const ExrImage& image, const std::string& layer, bool openness) {
  Plane out{image.width, image.height, {}, {}};
  const auto scale = image.attributes.find("lmcScale");
  const float unit = scale == image.attributes.end() ? 1.0f : scale->second;
  const std::array<std::string, 3> names = openness ? std::array<std::string, 3>{layer + "Y", layer + "Y", layer + "Y"}
                                                    : std::array<std::string, 3>{layer + "R", layer + "G", layer + "B"};
  out.value.assign(std::size_t(image.width) * std::size_t(image.height), glm::vec3(0.0f));
  out.there.assign(out.value.size(), 1);
  for (int c = 0; c < 3; ++c)
    if (const auto it = image.channels.find(names[std::size_t(c)]); it != image.channels.end())
      for (std::size_t i = 0; i < out.value.size(); ++i) out.value[i][c] = unit * it->second[i];
  if (const auto it = image.channels.find("A"); it != image.channels.end())
    for (std::size_t i = 0; i < out.there.size(); ++i) out.there[i] = it->second[i] > 0.5f;
  return out;
}

double meanOf(const Plane& p) {
  double sum = 0.0, n = 0.0;
  for (std::size_t i = 0; i < p.value.size(); ++i)
    if (p.there[i]) {
      sum += double(p.value[i].x + p.value[i].y + p.value[i].z) / 3.0;
      n += 1.0;
    }
  return n > 0.0 && sum > 0.0 ? sum / n : 1.0;
}

/// Dark blue, green, yellow, red: each step of ten is plain, on paper too.
glm::u8vec4 heatColour(double share) {
  constexpr std::array<std::array<double, 3>, 5> kStops{{{24, 20, 70}, {38, 110, 160}, {90, 190, 120}, {250, 215, 70}, {210, 40, 30}}};
  const double at = std::clamp(share, 0.0, 1.0) * 4.0;
  const auto k = std::min<std::size_t>(3, std::size_t(at));
  glm::u8vec4 out(0, 0, 0, 255);
  for (int c = 0; c < 3; ++c)
    out[c] = std::uint8_t(
        std::lround(kStops[k][std::size_t(c)] + (at - double(k)) * (kStops[k + 1][std::size_t(c)] - kStops[k][std::size_t(c)])));
  return out;
}
glm::u8vec4 heatOf(double error) { return heatColour(std::log(std::max(error, 1e-9) / kLeastShown) / std::log(kMostShown / kLeastShown)); }

constexpr glm::u8vec4 kNothing(236, 236, 236, 255);

/// f(texels) of each block that a pixel stands for: a colour from the covered texels' numbers.
template <class F>
Picture drawn(const Plane& p, F&& colourOf) {
  const int step = std::max(1, (std::max(p.width, p.height) + kSide - 1) / kSide);
  Picture out((p.width + step - 1) / step, (p.height + step - 1) / step, kNothing);
  std::vector<std::size_t> here;
  for (int y = 0; y < out.height; ++y)
    for (int x = 0; x < out.width; ++x) {
      here.clear();
      for (int ty = y * step; ty < std::min(p.height, (y + 1) * step); ++ty)
        for (int tx = x * step; tx < std::min(p.width, (x + 1) * step); ++tx) {
          const std::size_t i = std::size_t(ty) * std::size_t(p.width) + std::size_t(tx);
          if (p.there[i]) here.push_back(i);
        }
      if (!here.empty()) out.at(x, y) = colourOf(std::span<const std::size_t>(here));
    }
  return out;
}

Picture thumbnailOf(const Plane& p, double mean) {
  return drawn(p, [&](std::span<const std::size_t> here) {
    glm::vec3 sum(0.0f);
    for (const std::size_t i : here) sum += p.value[i] / float(here.size());
    glm::u8vec4 out(0, 0, 0, 255);
    for (int c = 0; c < 3; ++c) {
      const double v = std::max(0.0, double(sum[c]) / (2.5 * mean));
      out[c] = std::uint8_t(std::lround(255.0 * std::pow(std::min(1.0, v), 1.0 / 2.2)));
    }
    return out;
  });
}

Picture heatMapOf(const Plane& p, double mean) {
  return drawn(p, [&](std::span<const std::size_t> here) {
    double squares = 0.0;
    for (const std::size_t i : here) squares += double(glm::dot(p.value[i], p.value[i])) / 3.0 / double(here.size());
    return heatOf(std::sqrt(squares) / mean);
  });
}

/// Few texels of a reference would hardly be seen: each is drawn wider.
Plane spread(Plane p) {
  const double covered = double(std::ranges::count(p.there, std::uint8_t(1)));
  const int reach = covered < 0.02 * double(p.there.size()) ? std::max(1, p.width / 100) : 0;
  if (reach == 0) return p;
  const Plane from = p;
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x) {
      const std::size_t i = std::size_t(y) * std::size_t(p.width) + std::size_t(x);
      if (!from.there[i]) continue;
      for (int dy = -reach; dy <= reach; ++dy)
        for (int dx = -reach; dx <= reach; ++dx) {
          const int px = x + dx, py = y + dy;
          if (px < 0 || py < 0 || px >= p.width || py >= p.height) continue;
          const std::size_t k = std::size_t(py) * std::size_t(p.width) + std::size_t(px);
          p.there[k] = 1;
          if (!from.there[k]) p.value[k] = from.value[i];
        }
    }
  return p;
}

Plane difference(Plane a, const Plane& b) {
  if (a.value.size() != b.value.size()) return {};
  for (std::size_t i = 0; i < a.value.size(); ++i) {
    a.value[i] -= b.value[i];
    a.there[i] = a.there[i] && b.there[i];
  }
  return a;
}

std::string base64(const std::vector<std::uint8_t>& bytes) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t v = 0;
    for (std::size_t k = 0; k < 3; ++k) v = v << 8 | (i + k < bytes.size() ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k > bytes.size() - i ? '=' : kDigits[v >> (18 - 6 * k) & 63u];
  }
  return out;
}

std::string figure(const Picture& picture, const std::string& words) {
  if (picture.empty()) return {};
  return fmt::format(
      "<figure><img width=\"{}\" height=\"{}\" alt=\"{}\" src=\"data:image/png;base64,{}\"><figcaption>{}</figcaption></figure>\n",
      picture.width, picture.height, escapedForXml(words), base64(encodePng(picture, false)), escapedForXml(words));
}

std::string percent(const Json& v) { return v.is_number() ? fmt::format("{:.2f} %", 100.0 * double(v)) : "–"; }

std::string tableOf(const Json& study) {
  const bool truth = study.contains("reference");
  std::string out = fmt::format("<table>\n<tr><th>{}</th><th>promised</th><th>estimated</th><th>interval</th><th>bound</th>{}",
                                escapedForXml(study["knob"]), truth ? "<th>true</th>" : "");
  out += "<th>CPU s</th><th>rays</th><th>memory</th><th>goal</th></tr>\n";
  for (const Json& r : study["rungs"]) {
    out +=
        fmt::format("<tr><td>{}</td><td>{}</td><td>{}</td><td>{} to {}</td><td>{}</td>", escapedForXml(r["name"]), percent(r["promised"]),
                    percent(r["estimate"]), percent(r["interval"][0]), percent(r["interval"][1]), percent(r["bound95"]));
    if (truth) out += fmt::format("<td>{}</td>", r.contains("true") ? percent(r["true"]["net"]) : "–");
    out += fmt::format("<td>{:.2f}</td><td>{}</td><td>{:.0f} MB</td><td>{}</td></tr>\n", double(r["cpu_seconds"]), std::uint64_t(r["rays"]),
                       double(r["peak_memory_bytes"]) / 1e6, bool(r["goal_met"]) ? "met" : "missed");
  }
  return out + "</table>\n";
}

std::string stagesOf(const Json& study) {
  if (study["rungs"].empty()) return {};
  std::string out = "<table>\n<tr><th>CPU seconds by stage</th>";
  for (const Json& s : study["rungs"][0]["stages"]) out += fmt::format("<th>{}</th>", escapedForXml(s["name"]));
  out += "</tr>\n";
  for (const Json& r : study["rungs"]) {
    out += fmt::format("<tr><td>{}</td>", escapedForXml(r["name"]));
    for (const Json& s : r["stages"]) out += fmt::format("<td>{:.2f}</td>", double(s["cpu_seconds"]));
    out += "</tr>\n";
  }
  return out + "</table>\n";
}

std::string scaleOf() {
  Picture bar(320, 14, kNothing);
  for (int x = 0; x < bar.width; ++x)
    for (int y = 0; y < bar.height; ++y) bar.at(x, y) = heatColour(double(x) / double(bar.width - 1));
  return figure(bar, fmt::format("error against the level's mean: {:g} % (left) to {:g} % (right), in logarithms", 100.0 * kLeastShown,
                                 100.0 * kMostShown));
}

constexpr const char* kStyle =
    R"(body{font:15px/1.45 sans-serif;color:#222;background:#fff;max-width:1020px;margin:1.5em auto;padding:0 1em}
h1{font-size:1.5em}h2{font-size:1.15em;margin:1.4em 0 .4em}table{border-collapse:collapse;margin:.8em 0;font-size:.87em}
td,th{border:1px solid #ccc;padding:.2em .5em;text-align:right}td:first-child,th:first-child{text-align:left}
svg{width:100%;height:auto}figure{display:inline-block;margin:.3em .6em .3em 0;vertical-align:top;max-width:330px}
img{image-rendering:pixelated;width:235px;max-width:100%;height:auto;border:1px solid #ccc}.scale img{width:320px}figcaption{font-size:.8em;color:#555}
section{break-inside:avoid}h2{break-after:avoid}@media print{body{max-width:none;margin:0;font-size:11px}figure{max-width:31%}
*{-webkit-print-color-adjust:exact;print-color-adjust:exact}}@page{margin:14mm})";

}  // namespace

std::string pageOf(const Json& study, const std::string& svg, const std::vector<PagePictures>& pictures) {
  const std::string title = fmt::format("What accuracy costs: {}", std::string(study["level"]));
  std::string out = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title><link rel=\"icon\" href=\"data:,\">\n"
      "<style>{1}</style></head>\n<body>\n<h1>{0}</h1>\n<p>{2}</p>\n",
      escapedForXml(title), kStyle, escapedForXml(study["text"]));
  out += svg + tableOf(study) + stagesOf(study) + "<div class=\"scale\">" + scaleOf() + "</div>\n";
  double mean = 0.0;
  for (std::size_t k = 0; k < pictures.size(); ++k) {
    const PagePictures& p = pictures[k];
    out += fmt::format("<section><h2>{}</h2>\n", escapedForXml(study["rungs"][k]["name"]));
    for (std::size_t m = 0; m < p.maps.size(); ++m) {
      const ExrImage image = readExr(p.maps[m]);
      Plane value = planeOf(image, "", p.openness);
      if (mean == 0.0) mean = meanOf(value);
      out += figure(thumbnailOf(value, p.openness ? 0.4 : mean), p.openness ? "openness" : "light map");
      Plane stated = planeOf(image, "stderr.", p.openness);
      out += figure(heatMapOf(stated, mean), "standard error, as the map states it");
      if (m < p.references.size())
        out += figure(heatMapOf(spread(difference(value, planeOf(readExr(p.references[m]), "", p.openness))), mean),
                      "difference from the reference");
      if (m < p.finest.size())
        out += figure(heatMapOf(difference(value, planeOf(readExr(p.finest[m]), "", p.openness)), mean), "difference from the finest rung");
    }
    out += "</section>\n";
  }
  return out + "</body></html>\n";
}

}  // namespace lmc
