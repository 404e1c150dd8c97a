#include "libscene/exr.h"

#include <ImfChannelList.h>
#include <ImfFloatAttribute.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfThreading.h>
#include <fmt/format.h>
#include <half.h>

#include <cassert>
#include <cmath>
#include <cstring>

#include "libscene/exr_header.h"

namespace lmc {

namespace {

/// OpenEXR's own stream reports success on a full disk for small files; this one sees every error.
class Sink : public Imf::OStream {
 public:
  explicit Sink(OutputFile& file) : Imf::OStream("lmc"), file_(file) {}
  void write(const char c[], int n) override { file_.write(c, std::size_t(n)); }
  uint64_t tellp() override { return file_.position(); }
  void seekp(uint64_t position) override { file_.seek(position); }

 private:
  OutputFile& file_;
};

class Source : public Imf::IStream {
 public:
  explicit Source(std::vector<std::uint8_t> bytes) : Imf::IStream("lmc"), bytes_(std::move(bytes)) {}
  bool read(char c[], int n) override {
    if (n < 0 || at_ > bytes_.size() || std::size_t(n) > bytes_.size() - at_) throw std::runtime_error("file ends too early");
    std::memcpy(c, bytes_.data() + at_, std::size_t(n));
    at_ += std::size_t(n);
    return at_ < bytes_.size();
  }
  uint64_t tellg() override { return at_; }
  void seekg(uint64_t position) override { at_ = std::size_t(position); }

 private:
  std::vector<std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

constexpr int kRows = 32;  // one PIZ block: rows are turned to halves a block at a time

/// OpenEXR makes its pool of threads, even of none, within the first task; where memory runs out just then, whoever waits for that task
/// waits for ever.
void makePool() { Imf::setGlobalThreadCount(0); }

}  // namespace

void writeExr(OutputFile& file, int width, int height, const std::vector<ExrChannel>& channels,
              const std::map<std::string, float>& attributes) {
  makePool();
  Imf::Header header(width, height);
  header.compression() = Imf::PIZ_COMPRESSION;
  for (const auto& [name, value] : attributes) header.insert(name, Imf::FloatAttribute(value));
  for (const ExrChannel& c : channels) header.channels().insert(c.name, Imf::Channel(Imf::HALF));

  Sink sink(file);
  Imf::OutputFile out(sink, header, 1);  // one thread: the order of blocks is the order of rows
  std::vector<std::vector<half>> rows(channels.size(), std::vector<half>(std::size_t(width) * kRows));
  for (int y = 0; y < height; y += kRows) {
    const int n = std::min(kRows, height - y);
    Imf::FrameBuffer frame;
    for (std::size_t c = 0; c < channels.size(); ++c) {
      for (int i = 0; i < n * width; ++i) {
        const float v = channels[c].data[(std::size_t(y) * std::size_t(width) + std::size_t(i)) * channels[c].stride];
        assert(std::isfinite(v) && std::abs(v) <= 65504.0f);
        rows[c][std::size_t(i)] = half(v);
      }
      // OpenEXR wants the address of pixel (0, 0); it is never read.
      char* base = reinterpret_cast<char*>(rows[c].data()) - std::ptrdiff_t(y) * width * std::ptrdiff_t(sizeof(half));
      frame.insert(channels[c].name, Imf::Slice(Imf::HALF, base, sizeof(half), sizeof(half) * std::size_t(width)));
    }
    out.setFrameBuffer(frame);
    out.writePixels(n);
  }
}

ExrImage readExr(const std::filesystem::path& path, std::uint64_t maxPixels) {
  std::vector<std::uint8_t> bytes = readFile(path);
  try {
    checkExrHeader(path, bytes, maxPixels);
    makePool();
    Source source(std::move(bytes));
    Imf::InputFile in(source, 1);
    const Imf::Header& header = in.header();
    const Imath::Box2i window = header.dataWindow();
    const std::int64_t w = std::int64_t(window.max.x) - window.min.x + 1, h = std::int64_t(window.max.y) - window.min.y + 1;
    ExrImage image;
    image.width = int(w);
    image.height = int(h);
    Imf::FrameBuffer frame;
    for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
      std::vector<float>& data = image.channels[c.name()];
      data.resize(std::size_t(w * h));
      char* base = reinterpret_cast<char*>(data.data()) - (std::ptrdiff_t(window.min.y) * w + window.min.x) * std::ptrdiff_t(sizeof(float));
      frame.insert(c.name(), Imf::Slice(Imf::FLOAT, base, sizeof(float), sizeof(float) * std::size_t(w)));
    }
    for (auto a = header.begin(); a != header.end(); ++a)
      if (std::strcmp(a.attribute().typeName(), "float") == 0)
        image.attributes[a.name()] = static_cast<const Imf::FloatAttribute&>(a.attribute()).value();
    in.setFrameBuffer(frame);
    in.readPixels(window.min.y, window.max.y);
    return image;
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw Error(Exit::Limit, path, "", "not enough memory to read it", "LMC_MEMORY");
  } catch (const std::exception& e) {
    throw Error(Exit::Broken, path, "", fmt::format("is not a readable EXR file: {}", e.what()), "LMC_EXR");
  }
}

}  // namespace lmc
