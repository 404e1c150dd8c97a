#include "libscene/paging.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <string>
#include <thread>
#include <vector>

#include "libscene/error.h"
#include "libscene/parallel.h"
#include "libscene/rng.h"
#include "libscene/texel_array.h"

namespace lmc {
namespace {

namespace fs = std::filesystem;

class PagingTest : public testing::Test {
 protected:
  PagingTest() : folder_(fs::temp_directory_path() / ("lmc-paging-" + std::to_string(::getpid()))) { fs::create_directories(folder_); }
  ~PagingTest() override { fs::remove_all(folder_); }
  bool folderIsEmpty() const { return fs::is_empty(folder_); }

  /// Numbers that tell their place.
  static TexelArray<std::uint32_t> counted(std::size_t n) {
    TexelArray<std::uint32_t> out(n);
    std::iota(out.begin(), out.end(), 1u);
    return out;
  }
  static std::size_t wrong(const TexelArray<std::uint32_t>& a) {
    std::size_t out = 0;
    for (std::size_t i = 0; i < a.size(); ++i) out += a[i] != std::uint32_t(i) + 1;
    return out;
  }

  /// What of an array lies in memory, by the kernel's list of mappings: of the whole process a sanitizer's own memory would be a part.
  static std::uint64_t residentOf(const TexelArray<std::uint32_t>& a) {
    const auto begin = reinterpret_cast<std::uintptr_t>(a.begin()), end = reinterpret_cast<std::uintptr_t>(a.end());
    std::uint64_t out = 0;
    bool within = false;
    std::ifstream mappings("/proc/self/smaps");
    for (std::string line; std::getline(mappings, line);) {
      unsigned long from = 0, to = 0, kilobytes = 0;
      if (std::sscanf(line.c_str(), "%lx-%lx ", &from, &to) == 2)
        within = from < end && begin < to;
      else if (within && std::sscanf(line.c_str(), "Rss: %lu kB", &kilobytes) == 1)
        out += 1024 * std::uint64_t(kilobytes);
    }
    return out;
  }

  /// Of all files together, at one moment: residentOf goes over an array while others let it go, and may count a piece twice.
  static std::uint64_t residentOfFiles() {
    std::ifstream in("/proc/self/statm");
    std::uint64_t all = 0, resident = 0, ofFiles = 0;
    in >> all >> resident >> ofFiles;
    return ofFiles * std::uint64_t(::sysconf(_SC_PAGESIZE));
  }

  static constexpr std::uint64_t kPlenty = std::uint64_t(1) << 40;
  const fs::path folder_;
};

TEST_F(PagingTest, ArraysBeginAsZerosAndHoldTheirContentOverAReleaseAtOddSizes) {
  const Paging paging(folder_, kPlenty, 1, 1);
  for (const std::size_t n :
       {std::size_t(0), std::size_t(1), std::size_t(1023), std::size_t(1024), std::size_t(1025), std::size_t(1234567)}) {
    const TexelArray<std::uint32_t> zeros(n);
    EXPECT_EQ(std::accumulate(zeros.begin(), zeros.end(), std::uint64_t(0)), 0u) << n;
    const TexelArray<std::uint32_t> a = counted(n);
    Paging::release();
    EXPECT_EQ(wrong(a), 0u) << n;
    Paging::release();
    TexelArray<std::uint32_t> copy = a;
    Paging::release();
    EXPECT_EQ(copy, a) << n;
    if (n > 0) {
      copy[n / 2] = 0;
      Paging::release();
      EXPECT_EQ(wrong(copy), 1u) << n;
    }
  }
}

TEST_F(PagingTest, AReleaseMakesThemNotResidentAndReadingBringsThemBack) {
  constexpr std::uint64_t kBytes = 64 << 20;
  const Paging paging(folder_, kPlenty, 1);
  const TexelArray<std::uint32_t> a = counted(kBytes / 4);
  EXPECT_GT(residentOf(a), kBytes / 2);
  EXPECT_GT(residentBytes(), residentOf(a));
  Paging::release();
  EXPECT_LT(residentOf(a), kBytes / 2);
  EXPECT_EQ(wrong(a), 0u);
}

TEST_F(PagingTest, AReadBringsInLittleOfWhatLiesBesideIt) {
  // What looks at one texel here and there would else bring in all, faster than anybody lets go of it.
  constexpr std::uint64_t kBytes = 256 << 20, kApart = 2 << 20, kAround = 64 << 10;  // the kernel's own, unless it is told otherwise
  const Paging paging(folder_, kPlenty, 1);
  const TexelArray<std::uint32_t> a = counted(kBytes / 4);
  Paging::release();
  std::size_t reads = 0;
  for (std::size_t i = kApart / 8; i < a.size(); i += kApart / 4, ++reads) EXPECT_EQ(a[i], std::uint32_t(i) + 1);
  EXPECT_LE(residentOf(a), 2 * reads * kAround);
}

TEST_F(PagingTest, FilesHaveNoNamesAndArraysOutliveThePaging) {
  TexelArray<std::uint32_t> a;
  {
    const Paging paging(folder_, kPlenty, 1);
    a = counted(1 << 20);
    EXPECT_TRUE(folderIsEmpty());
  }
  Paging::release();
  EXPECT_EQ(wrong(a), 0u);
  EXPECT_TRUE(folderIsEmpty());
}

TEST_F(PagingTest, SmallArraysStayInMemory) {
  const Paging paging(folder_, kPlenty, 1, std::size_t(1) << 30);
  const TexelArray<std::uint32_t> a = counted(16 << 20);
  const std::uint64_t before = residentBytes();
  Paging::release();
  EXPECT_GT(residentBytes() + (1 << 20), before);
}

TEST_F(PagingTest, ThreadsWriteWhileAllIsLetGo) {
  const Paging paging(folder_, kPlenty, 1);
  constexpr std::size_t kThreads = 4, kEach = 1 << 20;
  TexelArray<std::uint32_t> a(kThreads * kEach);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < kThreads; ++t)
    threads.emplace_back([&, t] {
      // Twice, so that what was let go is read and changed.
      for (std::size_t i = t; i < a.size(); i += kThreads) a[i] += std::uint32_t(i);
      for (std::size_t i = t; i < a.size(); i += kThreads) a[i] += 1;
    });
  for (int k = 0; k < 50; ++k) {
    Paging::release();
    std::this_thread::yield();
  }
  for (std::thread& t : threads) t.join();
  EXPECT_EQ(wrong(a), 0u);
}

TEST_F(PagingTest, TheProcessKeepsToItsMost) {
  constexpr std::uint64_t kMost = 64 << 20, kArray = 512 << 20;
  const Paging paging(folder_, residentBytes() + kMost, 1);
  TexelArray<std::uint32_t> a(kArray / 4);
  std::uint64_t most = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    a[i] = std::uint32_t(i) + 1;
    if (i % (1 << 18) == 0) most = std::max(most, residentOf(a));
  }
  EXPECT_EQ(wrong(a), 0u);
  // No loop of many threads: the keeper looks, when it gets to run. Half of the array is far more than it lets pass even on a machine that
  // is busy.
  EXPECT_LT(most, kArray / 2);
}

TEST_F(PagingTest, LoopsOfManyThreadsKeepToItWithinWhatTheyHaveInWork) {
  // At the start of an item no more is in memory than may be, but for what other threads have brought in since they last looked: a piece
  // each, or in random places their share of half of the room. The program's own pages may come in meanwhile, too.
  constexpr std::uint64_t kMost = 64 << 20, kPiece = 2 << 20, kPieces = 256, kProgram = 8 << 20;
  constexpr std::size_t kEntries = kPiece / 4, kReads = 4096;
  constexpr int kThreads = 4;
  const Paging paging(folder_, residentBytes() + kMost, kThreads);
  TexelArray<std::uint32_t> a(kPieces * kEntries);
  const lmc::Run run{kThreads};
  const std::uint64_t others = residentOfFiles();  // the program itself
  std::atomic<std::uint64_t> most = 0, sum = 0;
  const auto look = [&] {
    const std::uint64_t now = residentOfFiles() - others;
    for (std::uint64_t before = most; now > before && !most.compare_exchange_weak(before, now);) {
    }
  };
  withThreads(run, [&] {
    parallelFor(run, kPieces, 1, [&](std::size_t p) {
      look();
      std::iota(a.begin() + p * kEntries, a.begin() + (p + 1) * kEntries, std::uint32_t(p * kEntries) + 1);
    });
    EXPECT_LT(most, kMost + kThreads * kPiece + kProgram) << "written";
    most = 0;
    parallelFor(run, kPieces, 1, [&](std::size_t p) {
      look();
      sum += std::accumulate(a.begin() + p * kEntries, a.begin() + (p + 1) * kEntries, std::uint64_t(0));
    });
    EXPECT_LT(most, kMost + kThreads * kPiece + kProgram) << "read";
    most = 0;
    parallelFor(run, 16, 1, [&](std::size_t p) {
      for (std::size_t k = 0; k < kReads; ++k) {
        const std::size_t i = std::size_t(combine(p, k)) % a.size();
        Paging::touched();
        EXPECT_EQ(a[i], std::uint32_t(i) + 1);
        if (k % 64 == 0) look();
      }
    });
    EXPECT_LT(most, kMost + kMost / 2 + kThreads * kPiece + kProgram) << "read at random";
  });
  EXPECT_EQ(sum, a.size() * (a.size() + 1) / 2);
  EXPECT_EQ(wrong(a), 0u);
}

TEST_F(PagingTest, AFullDiskIsALimitBeforeAnythingIsWritten) {
  // What ends a file that grows beyond the limit of its size is told by the same call that finds no room.
  struct rlimit before {};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto ignored = std::signal(SIGXFSZ, SIG_IGN);
  const Paging paging(folder_, kPlenty, 1);
  const rlimit small{8 << 20, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  try {
    const TexelArray<std::uint32_t> a(4 << 20);
    ADD_FAILURE() << "16 MB were set aside in files of at most 8 MB";
  } catch (const Error& e) {
    EXPECT_EQ(e.kind, Exit::Limit) << e.what();
    EXPECT_EQ(e.file, folder_.string());
  }
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, ignored);
  EXPECT_TRUE(folderIsEmpty());
  EXPECT_EQ(wrong(counted(1 << 20)), 0u) << "what fits goes on";
}

TEST_F(PagingTest, AFolderThatTakesNoFilesIsAnErrorOfOutput) {
  const Paging paging(folder_ / "missing", kPlenty, 1);
  try {
    const TexelArray<std::uint32_t> a(1 << 20);
    ADD_FAILURE();
  } catch (const Error& e) {
    EXPECT_EQ(e.kind, Exit::Io) << e.what();
  }
}

TEST(TexelArray, IsAValue) {
  TexelArray<float> a(3, 2.5f), b = a;
  EXPECT_EQ(a, b);
  b[1] = 1.0f;
  EXPECT_NE(a, b);
  TexelArray<float> c = std::move(b);
  EXPECT_EQ(c[1], 1.0f);
  EXPECT_TRUE(b.empty());  // NOLINT(bugprone-use-after-move): what a moved array is, is said
  c.assign(2, -0.0f);
  EXPECT_EQ(c.size(), 2u);
  EXPECT_TRUE(std::signbit(c[1]));
  c = {};
  EXPECT_TRUE(c.empty());
  EXPECT_EQ(c, TexelArray<float>());
}

}  // namespace
}  // namespace lmc
