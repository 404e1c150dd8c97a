#include "libscene/journal.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <random>
#include <thread>

#include "libscene/files.h"
#include "tests/support/scenes.h"

namespace lmc {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;
using Found = Journal::Found;

constexpr JournalKey kKey{1, 2, 3};
constexpr std::uint32_t kTiles = 12;

JournalPlace placeOf(std::uint32_t tile) { return {Loop(1 + tile % 3), tile / 3, tile}; }

/// Of a length and content of the tile's own; one of them is empty.
Bytes payloadOf(std::uint32_t tile) {
  Bytes out(tile == 5 ? 0 : 40 + 7 * tile);
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = std::uint8_t(31 * tile + k);
  return out;
}

class JournalFile : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "lmc-journal-XXXXXX").string();
    out = mkdtemp(name.data());
  }
  void TearDown() override { fs::remove_all(out); }
  fs::path folder() const { return out / Journal::kFolder; }
  fs::path file() const { return folder() / Journal::kFile; }
  void fill() const {
    Journal journal(out, kKey);
    for (std::uint32_t t = 0; t < kTiles; ++t) journal.put(placeOf(t), payloadOf(t));
  }
  void write(const Bytes& bytes) const {
    std::ofstream f(file(), std::ios::binary | std::ios::trunc);
    f.write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  }
  /// How many tiles a journal gives back; each must be as it was put.
  static std::uint32_t soundTiles(Journal& journal) {
    std::uint32_t sound = 0;
    Bytes payload;
    for (std::uint32_t t = 0; t < kTiles; ++t)
      if (journal.take(placeOf(t), payload)) {
        ++sound;
        EXPECT_EQ(payload, payloadOf(t)) << "tile " << t;
      }
    return sound;
  }
  fs::path out;
};

TEST_F(JournalFile, NothingIsMadeBeforeTheFirstTile) {
  Journal journal(out, kKey);
  EXPECT_EQ(journal.found(), Found::Nothing);
  Bytes payload;
  EXPECT_FALSE(journal.take(placeOf(0), payload));
  EXPECT_FALSE(fs::exists(folder()));
  EXPECT_FALSE(journalHoldsTiles());
  journal.put(placeOf(0), payloadOf(0));
  EXPECT_TRUE(fs::exists(file()));
  EXPECT_TRUE(journalHoldsTiles());
}

TEST_F(JournalFile, GivesBackInALaterRunWhatWasPut) {
  fill();
  Journal journal(out, kKey);
  EXPECT_EQ(journal.found(), Found::Tiles);
  EXPECT_EQ(journal.tilesFound(), kTiles);
  EXPECT_EQ(journal.bytesDropped(), 0u);
  EXPECT_EQ(soundTiles(journal), kTiles);
  EXPECT_EQ(journal.tilesTaken(), kTiles);
  EXPECT_EQ(journal.trouble(), "");
}

TEST_F(JournalFile, GivesBackInTheSameRunWhatWasPut) {
  Journal journal(out, kKey);
  for (std::uint32_t t = 0; t < kTiles; ++t) journal.put(placeOf(t), payloadOf(t));
  EXPECT_EQ(soundTiles(journal), kTiles);
}

TEST_F(JournalFile, RemoveLeavesNothingButWhatOthersPutThere) {
  fill();
  Journal(out, kKey).remove();
  EXPECT_FALSE(fs::exists(folder()));
  fill();
  std::ofstream(folder() / "mine") << "mine";
  Journal(out, kKey).remove();
  EXPECT_FALSE(fs::exists(file()));
  EXPECT_TRUE(fs::exists(folder() / "mine"));
}

TEST_F(JournalFile, AProcessThatEndsOutOfOrderUnlinksItsOwnAndNoOther) {
  fill();
  unlinkJournal();
  EXPECT_TRUE(fs::exists(file())) << "no run has it";
  {
    Journal first(out, kKey);
    ASSERT_EQ(first.found(), Found::Tiles);
    unlinkJournal();
    EXPECT_FALSE(fs::exists(folder()));
  }
  Journal made(out, kKey);
  made.put(placeOf(0), payloadOf(0));
  made.remove();
  fill();  // by another run
  unlinkJournal();
  EXPECT_TRUE(fs::exists(file()));
}

TEST_F(JournalFile, CutAnywhereItKeepsTheTilesThatAreWhole) {
  fill();
  const Bytes whole = readFile(file());
  std::uint32_t most = 0;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    write(Bytes(whole.begin(), whole.begin() + std::ptrdiff_t(size)));
    Journal journal(out, kKey);
    const std::uint32_t sound = soundTiles(journal);
    EXPECT_EQ(journal.tilesFound(), sound) << size;
    EXPECT_GE(sound, most) << "a longer part has no fewer tiles";
    EXPECT_LE(sound, kTiles - 1) << size;
    most = sound;
    EXPECT_EQ(journal.found(), size == 0 ? Found::Nothing : size < 48 ? Found::Damaged : Found::Tiles) << size;
  }
  EXPECT_EQ(most, kTiles - 1);
}

TEST_F(JournalFile, ABitThatFlippedIsNeverGivenBackAndTheRestIsPutAgain) {
  fill();
  const Bytes whole = readFile(file());
  std::mt19937 random(1);
  std::uint32_t lost = 0, kept = 0;
  for (int flip = 0; flip < 200; ++flip) {
    Bytes bytes = whole;
    const std::size_t bit = random() % (8 * bytes.size());
    bytes[bit / 8] ^= std::uint8_t(1u << bit % 8);
    write(bytes);
    {
      Journal journal(out, kKey);
      const std::uint32_t sound = soundTiles(journal);
      EXPECT_LT(sound, kTiles) << "bit " << bit << " belongs to nothing";
      EXPECT_NE(journal.found(), Found::Nothing);
      lost += kTiles - sound;
      kept += sound;
      Bytes payload;
      for (std::uint32_t t = 0; t < kTiles; ++t)
        if (!journal.take(placeOf(t), payload)) journal.put(placeOf(t), payloadOf(t));
    }
    Journal mended(out, kKey);
    EXPECT_EQ(mended.found(), Found::Tiles);
    EXPECT_EQ(soundTiles(mended), kTiles) << "bit " << bit;
  }
  EXPECT_GT(kept, 200u) << "what lies before the damage is of use";
  EXPECT_GT(lost, 200u);
}

TEST_F(JournalFile, ARecordThatLiesElsewhereIsNotSound) {
  fill();
  const Bytes whole = readFile(file());
  // The first record, 48 + 40 bytes, once more behind the last.
  Bytes bytes = whole;
  bytes.insert(bytes.end(), whole.begin() + 48, whole.begin() + 48 + 48 + 40);
  write(bytes);
  Journal journal(out, kKey);
  EXPECT_EQ(journal.bytesDropped(), 88u);
  EXPECT_EQ(journal.tilesFound(), kTiles);
}

TEST_F(JournalFile, OfAnotherVersionLevelOrOptionsItIsNamedAndDiscarded) {
  const std::pair<JournalKey, Found> others[] = {
      {{9, 2, 3}, Found::OtherVersion}, {{1, 9, 3}, Found::OtherLevel}, {{1, 2, 9}, Found::OtherOptions}, {{9, 9, 9}, Found::OtherVersion}};
  for (const auto& [key, found] : others) {
    fill();
    {
      Journal journal(out, key);
      EXPECT_EQ(journal.found(), found);
      EXPECT_EQ(soundTiles(journal), 0u);
      EXPECT_EQ(fs::file_size(file()), 0u);
      journal.put(placeOf(0), payloadOf(0));
    }
    Journal own(out, key);
    EXPECT_EQ(own.found(), Found::Tiles);
    EXPECT_EQ(soundTiles(own), 1u);
  }
}

TEST_F(JournalFile, ATileThatWasAskedForSomethingElseIsNone) {
  fill();
  Journal journal(out, kKey);
  JournalPlace place = placeOf(3);
  place.asked = 7;
  Bytes payload;
  EXPECT_FALSE(journal.take(place, payload));
  journal.put(place, payloadOf(4));
  ASSERT_TRUE(journal.take(place, payload));
  EXPECT_EQ(payload, payloadOf(4));
}

TEST_F(JournalFile, ManyThreadsPutWithoutLoss) {
  constexpr std::uint32_t kThreads = 8, kEach = 250;
  const auto payloadAt = [](std::uint32_t tile) { return Bytes(tile % 97, std::uint8_t(tile)); };
  {
    Journal journal(out, kKey);
    std::vector<std::thread> threads;
    for (std::uint32_t t = 0; t < kThreads; ++t)
      threads.emplace_back([&, t] {
        for (std::uint32_t k = 0; k < kEach; ++k) journal.put({Loop::Direct, t, k}, payloadAt(t * kEach + k));
      });
    for (std::thread& t : threads) t.join();
  }
  Journal journal(out, kKey);
  EXPECT_EQ(journal.tilesFound(), kThreads * kEach);
  Bytes payload;
  for (std::uint32_t t = 0; t < kThreads; ++t)
    for (std::uint32_t k = 0; k < kEach; ++k) {
      ASSERT_TRUE(journal.take({Loop::Direct, t, k}, payload));
      EXPECT_EQ(payload, payloadAt(t * kEach + k));
    }
}

TEST_F(JournalFile, AFullDiskTurnsItOffAndKeepsWhatIsWhole) {
  const auto before = std::signal(SIGXFSZ, SIG_IGN);
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  const rlimit small{600, limit.rlim_max};
  std::size_t kept = 0;
  {
    Journal journal(out, kKey);
    setrlimit(RLIMIT_FSIZE, &small);
    for (std::uint32_t t = 0; t < kTiles; ++t) journal.put(placeOf(t), payloadOf(t));
    setrlimit(RLIMIT_FSIZE, &limit);
    EXPECT_NE(journal.trouble().find("cannot be written"), std::string::npos);
    EXPECT_EQ(journal.trouble(), "") << "it is said once";
    kept = journal.tilesKept();
    journal.put(placeOf(kTiles - 1), payloadOf(kTiles - 1));
    EXPECT_EQ(journal.tilesKept(), kept) << "it stays off";
    EXPECT_EQ(soundTiles(journal), kept);
  }
  std::signal(SIGXFSZ, before);
  EXPECT_GT(kept, 0u);
  EXPECT_LT(kept, kTiles);
  Journal journal(out, kKey);
  EXPECT_EQ(soundTiles(journal), kept);
  EXPECT_EQ(journal.bytesDropped(), 0u);
}

TEST_F(JournalFile, ATileThatChangesUnderARunIsNotGivenBack) {
  fill();
  Journal journal(out, kKey);
  {
    std::fstream f(file(), std::ios::binary | std::ios::in | std::ios::out);
    f.seekp(48 + 48 + 3);
    f.put('\xff');
  }
  EXPECT_EQ(soundTiles(journal), kTiles - 1);
  EXPECT_NE(journal.trouble(), "");
}

TEST_F(JournalFile, LinksInItsPlaceAreNotFollowed) {
  fs::create_directory(out / "elsewhere");
  std::ofstream(out / "elsewhere" / Journal::kFile) << "mine";
  fs::create_directory_symlink(out / "elsewhere", folder());
  {
    Journal journal(out, kKey);
    EXPECT_EQ(journal.found(), Found::Unusable);
    EXPECT_NE(journal.trouble(), "");
    journal.put(placeOf(0), payloadOf(0));
    journal.remove();
  }
  fs::remove(folder());
  fs::create_directory(folder());
  fs::create_symlink(out / "elsewhere" / Journal::kFile, file());
  {
    Journal journal(out, kKey);
    EXPECT_EQ(journal.found(), Found::Unusable);
    journal.put(placeOf(0), payloadOf(0));
    journal.remove();
  }
  EXPECT_EQ(readFile(out / "elsewhere" / Journal::kFile), Bytes({'m', 'i', 'n', 'e'}));
  EXPECT_TRUE(fs::is_symlink(file()));
}

TEST_F(JournalFile, ARunAtWorkHasItToItself) {
  Journal first(out, kKey);
  first.put(placeOf(0), payloadOf(0));
  {
    Journal second(out, {9, 9, 9});
    EXPECT_EQ(second.found(), Found::InUse);
    second.put(placeOf(1), payloadOf(1));
    second.remove();
  }
  first.put(placeOf(1), payloadOf(1));
  EXPECT_EQ(soundTiles(first), 2u);
  EXPECT_TRUE(fs::exists(file()));
}

TEST_F(JournalFile, WorkThatIsTakenWritesWhatItWroteAndCountsItsRays) {
  const Scene scene = test::litRoom();
  std::array<float, 3> value{};
  double other = 0.0;
  const auto work = [&](Journal* journal) {
    const Tracer tracer(scene);
    lmc::Run run;
    run.journal = journal;
    value = {};
    other = 0.0;
    Journaled kept(run, tracer, placeOf(0), [&](auto& archive) {
      archive(value);
      archive(other);
    });
    if (!kept.taken()) {
      value = {1.0f, -0.0f, 1e-42f};
      other = 1.0 / 3.0;
      for (int k = 0; k < 5; ++k) tracer.occluded({glm::vec3(0.0f), glm::vec3(1.0f, 0.0f, 0.0f), 1.0f}, Purpose::Audit);
      kept.put();
    }
    EXPECT_EQ(tracer.rays(Purpose::Audit), 5u);
    EXPECT_EQ(tracer.rays(), 5u);
    EXPECT_TRUE(std::signbit(value[1]));
    EXPECT_EQ(value[2], 1e-42f);
    EXPECT_EQ(other, 1.0 / 3.0);
    return kept.taken();
  };
  EXPECT_FALSE(work(nullptr));
  Journal journal(out, kKey);
  EXPECT_FALSE(work(&journal));
  EXPECT_TRUE(work(&journal));
}

}  // namespace
}  // namespace lmc
