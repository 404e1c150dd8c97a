#include "libscene/files.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>

#include "libscene/exr.h"

namespace lmc {
namespace {

namespace fs = std::filesystem;

class Files : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "lmc-files-XXXXXX").string();
    folder = mkdtemp(name.data());
  }
  void TearDown() override { fs::remove_all(folder); }
  std::string text(const fs::path& p) const {
    const auto bytes = readFile(p);
    return {bytes.begin(), bytes.end()};
  }
  std::size_t count() const { return std::size_t(std::distance(fs::directory_iterator(folder), fs::directory_iterator())); }
  fs::path folder;
};

TEST_F(Files, NothingAppearsBeforeCommit) {
  std::ofstream(folder / "a") << "old";
  {
    OutputSet set(folder);
    set.open("a").write("new");
    set.open("b").write("new too");
    EXPECT_EQ(text(folder / "a"), "old");
    EXPECT_FALSE(fs::exists(folder / "b"));
    set.commit();
  }
  EXPECT_EQ(text(folder / "a"), "new");
  EXPECT_EQ(text(folder / "b"), "new too");
  EXPECT_EQ(count(), 2u);
}

TEST_F(Files, WithoutCommitNothingIsLeft) {
  std::ofstream(folder / "a") << "old";
  {
    OutputSet set(folder);
    set.open("a").write("new");
  }
  EXPECT_EQ(text(folder / "a"), "old");
  EXPECT_EQ(count(), 1u);
  { OutputSet set(folder / "made"); }
  EXPECT_FALSE(fs::exists(folder / "made")) << "a folder made for a run that failed goes again";
}

TEST_F(Files, HashIsOfWhatWasWritten) {
  OutputSet set(folder);
  OutputFile& f = set.open("x");
  f.write("abc");
  EXPECT_EQ(f.size(), 3u);
  EXPECT_EQ(f.hash(), contentHash(std::vector<std::uint8_t>{'a', 'b', 'c'}));
}

TEST_F(Files, AFileThatMayNotGrowIsALimitAndLeavesNothing) {
  // RLIMIT_FSIZE with SIGXFSZ ignored: write fails with EFBIG, as a full disk does with ENOSPC.
  const auto child = fork();
  if (child == 0) {
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{1024, 1024};
    setrlimit(RLIMIT_FSIZE, &limit);
    int code = 1;
    try {
      OutputSet set(folder);
      set.open("x").write(std::string(4096, 'a'));
      set.commit();
    } catch (const Error& e) {
      code = e.kind == Exit::Limit ? 0 : 2;
    }
    _exit(code);
  }
  int status = -1;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  EXPECT_EQ(count(), 0u);
}

TEST_F(Files, SeekingBackPatchesWhatWasWritten) {
  OutputSet set(folder);
  OutputFile& f = set.open("x");
  f.write("0123456789");
  f.seek(3);
  f.write("abc");
  f.seek(10);
  f.write("z");
  set.commit();
  EXPECT_EQ(text(folder / "x"), "012abc6789z");
}

TEST_F(Files, ReadingNamesWhatIsWrong) {
  const auto kind = [](const fs::path& p) {
    try {
      readFile(p);
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find(p.filename().string()), std::string::npos);
      return e.kind;
    }
    return Exit::Done;
  };
  EXPECT_EQ(kind(folder / "missing"), Exit::Io);
  EXPECT_EQ(kind(folder), Exit::Io);
  EXPECT_EQ(kind("/dev/zero"), Exit::Io);
  std::ofstream(folder / "big") << "12345";
  EXPECT_THROW(readFile(folder / "big", 4), Error);
}

TEST_F(Files, ErrorsStayOnOneLine) {
  const Error e(Exit::Broken, "a\nb.glb", "/x", "bad\tthing", "LMC_X");
  EXPECT_STREQ(e.what(), "a\\x0ab.glb:/x: error: bad\\x09thing [LMC_X]");
}

TEST_F(Files, ExrKeepsChannelsAndAttributes) {
  std::vector<float> r(100 * 70), a(100 * 70);
  for (std::size_t i = 0; i < r.size(); ++i) {
    r[i] = float(i % 2048);  // exact in half
    a[i] = float(i % 2);
  }
  for (int run = 0; run < 2; ++run) {
    OutputSet set(folder);
    writeExr(set.open(run ? "b.exr" : "a.exr"), 100, 70, {{"indirect.R", r.data(), 1}, {"A", a.data(), 1}}, {{"lmcScale", 4.0f}});
    set.commit();
  }
  EXPECT_EQ(text(folder / "a.exr"), text(folder / "b.exr"));
  const ExrImage image = readExr(folder / "a.exr");
  EXPECT_EQ(image.width, 100);
  EXPECT_EQ(image.height, 70);
  EXPECT_EQ(image.channels.at("indirect.R"), r);
  EXPECT_EQ(image.channels.at("A"), a);
  EXPECT_EQ(image.attributes.at("lmcScale"), 4.0f);
  EXPECT_THROW(readExr(folder / "a.exr", 100), Error);
}

}  // namespace
}  // namespace lmc
