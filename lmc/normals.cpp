#include "lmc/normals.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>

#include "libscene/files.h"
#include "libscene/image_file.h"
#include "libscene/parallel.h"
#include "lmc/bake.h"
#include "lmc/normal_map.h"

namespace lmc {

namespace {

constexpr int kGutter = 8;  // texels: three steps of a mip map

Image<glm::u16vec4> readPicture(const std::filesystem::path& file, const LoadLimits& limits) {
  DecodedDeepImage out = decodeDeepImage(readFile(file), limits.maxTexturePixels);
  if (out.problem) throw Error(Exit::Broken, file, "", out.problem->text, out.problem->code);
  return std::move(out.image);
}

/// Height is the first channel: all are one in a grey picture.
Image<float> firstChannel(const Image<glm::u16vec4>& picture) {
  Image<float> out(picture.width, picture.height);
  for (std::size_t i = 0; i < out.pixels.size(); ++i) out.pixels[i] = float(picture.pixels[i].r) / 65535.0f;
  return out;
}

const char* nameOf(Derivative d) { return d == Derivative::Central ? "central" : d == Derivative::Sobel ? "sobel" : "scharr"; }

class Job {
 public:
  explicit Job(const NormalsOptions& o) : o_(o), run_(stoppableRun(o.threads)) {}

  void make() {
    if (o_.source == NormalsOptions::Source::Model) return ofModel();
    const Image<glm::u16vec4> picture = readPicture(o_.map, o_.limits);
    if (o_.source == NormalsOptions::Source::Height || o_.source == NormalsOptions::Source::Picture) return ofHeight(picture);
    const bool fromObject = o_.source == NormalsOptions::Source::Object;
    normals_ = normalsOfPicture(picture, !fromObject && o_.greenDown);
    if (fromObject != (o_.toObject)) convert(normals_, fromObject);
    report_["from"] = fromObject ? "object" : "tangent";
  }

  void write() const {
    const bool down = !o_.toObject && o_.greenDown;  // only tangent space has a green that can point two ways
    const std::vector<std::uint8_t> png =
        o_.bits == 16 ? encodePng(pictureOfNormals16(normals_, down), false) : encodePng(pictureOfNormals8(normals_, down), false);
    writeFileWhole(o_.out, {reinterpret_cast<const char*>(png.data()), png.size()});
  }

  nlohmann::ordered_json report() const {
    nlohmann::ordered_json out{{"space", o_.toObject ? "object" : "tangent"}};
    if (!o_.toObject) out["green"] = o_.greenDown ? "down" : "up";
    out["bits"] = o_.bits;
    out["width"] = normals_.width;
    out["height"] = normals_.height;
    out.update(report_);
    return out;
  }

 private:
  Scene mesh() const {
    if (o_.mesh.empty()) throw Error(Exit::Usage, "lmc", "", "normals: this needs the model that the map is for: --mesh FILE.glb");
    return loadLevel(o_.mesh, o_.limits, run_);
  }

  Image<TexelFrame> framesOf(const Scene& scene, int width, int height) {
    Image<TexelFrame> frames = texelFrames(scene, scene.uv0, width, height, kGutter, run_);
    report_["texels_without_triangle"] = std::ranges::count_if(frames.pixels, [](const TexelFrame& f) { return !f.covered(); });
    return frames;
  }

  void convert(const Image<glm::vec3>& from, bool fromObject) {
    const Image<TexelFrame> frames = framesOf(mesh(), from.width, from.height);
    normals_ = fromObject ? toTangentSpace(frames, from) : toObjectSpace(frames, from);
  }

  void ofHeight(const Image<glm::u16vec4>& picture) {
    const bool height = o_.source == NormalsOptions::Source::Height;
    const HeightOptions how{float(o_.scale), o_.repeat, Derivative(o_.filter)};
    normals_ = normalsOfHeight(height ? firstChannel(picture) : luminanceOf(picture), how);
    if (o_.toObject) convert(normals_, false);
    report_["from"] = height ? "height" : "luminance";
    report_["scale"] = o_.scale;
    report_["wrap"] = o_.repeat ? "repeat" : "clamp";
    report_["filter"] = nameOf(how.filter);
  }

  void ofModel() {
    const Scene low = mesh(), high = loadLevel(o_.map, o_.limits, run_);
    const Tracer tracer(high);
    const Image<TexelFrame> frames = framesOf(low, o_.size, o_.size);
    const double cage_m = o_.cage_m > 0.0 ? o_.cage_m : 0.05 * double(low.extent_m);
    ModelNormals got = normalsOfModel(frames, low.centre_m, high, tracer, cage_m, run_);
    normals_ = o_.toObject ? std::move(got.normals) : toTangentSpace(frames, got.normals);
    report_["from"] = "model";
    report_["cage_m"] = cage_m;
    report_["rays"] = got.rays;
    report_["misses"] = got.misses;
  }

  const NormalsOptions& o_;
  Run run_;
  Image<glm::vec3> normals_;
  nlohmann::ordered_json report_;
};

}  // namespace

Exit normals(const NormalsOptions& options) {
  Job job(options);
  withThreads(Run{options.threads}, [&] { job.make(); });
  job.write();
  const nlohmann::ordered_json report = job.report();
  if (options.json) {
    fmt::print("{}\n", report.dump(2));
    return Exit::Done;
  }
  for (const auto& [key, value] : report.items())
    fmt::print("{:<24} {}\n", key, value.is_string() ? value.get<std::string>() : value.dump());
  return Exit::Done;
}

}  // namespace lmc
