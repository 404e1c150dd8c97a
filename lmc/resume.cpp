#include "lmc/resume.h"

#include <elf.h>
#include <fmt/format.h>
#include <link.h>

#include <algorithm>
#include <cstring>

#include "libscene/files.h"

namespace lmc {

namespace {

std::uint64_t hashOf(std::string_view text) { return hash64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}); }

/// Build identifiers of the program and of every library that it has loaded: a version's number stays while it is worked on.
std::string buildIds() {
  std::string out;
  dl_iterate_phdr(
      [](dl_phdr_info* object, std::size_t, void* data) {
        for (int k = 0; k < object->dlpi_phnum; ++k) {
          const ElfW(Phdr)& part = object->dlpi_phdr[k];
          if (part.p_type != PT_NOTE) continue;
          const char* notes = reinterpret_cast<const char*>(object->dlpi_addr + part.p_vaddr);
          const auto whole = [](std::size_t bytes) { return (bytes + 3) & ~std::size_t(3); };
          for (std::size_t at = 0; at + sizeof(ElfW(Nhdr)) <= part.p_memsz;) {
            ElfW(Nhdr) note;
            std::memcpy(&note, notes + at, sizeof(note));
            const std::size_t name = at + sizeof(note), content = name + whole(note.n_namesz), end = content + whole(note.n_descsz);
            if (end > part.p_memsz) break;
            if (note.n_type == NT_GNU_BUILD_ID && note.n_namesz == 4 && std::memcmp(notes + name, "GNU", 4) == 0)
              static_cast<std::string*>(data)->append(notes + content, note.n_descsz);
            at = end;
          }
        }
        return 0;
      },
      &out);
  return out;
}

/// What a ray finds may hang on it in the last bit.
std::string instructionSet() {
#if defined(__x86_64__)
  return fmt::format("x86-64 {:d}{:d}{:d}{:d}", __builtin_cpu_supports("sse4.2") != 0, __builtin_cpu_supports("avx") != 0,
                     __builtin_cpu_supports("avx2") != 0, __builtin_cpu_supports("avx512f") != 0);
#else
  return "one";
#endif
}

/// Every option that may change what a tile holds. Those that change none (threads, memory, progress, what else is written, what is judged
/// at the end) may be others when a bake is gone on with.
std::string textOf(const BakeOptions& o) {
  std::string text = fmt::format("goal {} effects {} passes {} tail {} snapshot {} solver {} patch {} {} gather {} {} {} links {}", o.goal,
                                 o.effects, o.passes, o.bounceTail, o.snapshot, int(o.solver), o.patchSize_m, o.maxPatches, o.interpolate,
                                 o.gatherRays, o.gatherRounds, o.maxLinks);
  text += fmt::format(" partition {} {}", o.partition.automatic, fmt::join(o.partition.on, ","));
  text += fmt::format(" uv {} {} {} {} {}", int(o.uv.mode), o.uv.mapSize, o.uv.texelsPerMetre, o.uv.padding, o.uv.maxMaps);
  text += fmt::format(" ao {} {} {} {}", o.ao.how.error, o.ao.how.distance_m, int(o.ao.how.fallOff), o.ao.how.rays);
  text += o.sky ? fmt::format(" sky {},{},{}", o.sky->r, o.sky->g, o.sky->b) : " sky of the scene";
  return text + fmt::format(" seed {}", o.seed);
}

JournalKey keyOf(const Bake& b) {
  return {hashOf(std::string(LMC_VERSION) + instructionSet() + buildIds()), b.scene.content, hashOf(textOf(b.options))};
}

std::string nameOf(const BakeOptions& o) { return (o.out / Journal::kFolder).string(); }

const char* differsBy(Journal::Found found) {
  switch (found) {
    case Journal::Found::OtherVersion:
      return "is of another version of lmc, or of another processor";
    case Journal::Found::OtherLevel:
      return "is of another level, or the level has changed";
    case Journal::Found::OtherOptions:
      return "is of a bake with other options";
    default:
      return "is damaged";
  }
}

/// What is said of a journal when it is opened; nothing where there was none.
std::string textOf(const Journal& j) {
  switch (j.found()) {
    case Journal::Found::Nothing:
    case Journal::Found::Unusable:
      return {};
    case Journal::Found::InUse:
      return "another run has the journal of this folder: this one keeps none";
    case Journal::Found::Tiles:
      return fmt::format(
          "going on with {} tiles of a run that was stopped{}", j.tilesFound(),
          j.bytesDropped() == 0 ? "" : fmt::format("; {} bytes behind them are cut or damaged, and done again", j.bytesDropped()));
    default:
      return fmt::format("the journal {}: it is discarded, and the bake starts from zero", differsBy(j.found()));
  }
}

}  // namespace

std::unique_ptr<Journal> openJournal(const Bake& b) {
  const BakeOptions& o = b.options;
  if (o.time_s > 0.0) return nullptr;
  if (!o.resume) {
    Journal(o.out, {}).remove();
    return nullptr;
  }
  auto journal = std::make_unique<Journal>(o.out, keyOf(b));
  if (const std::string text = textOf(*journal); !text.empty()) b.run.note({{}, nameOf(o), "", text, "LMC_RESUME"});
  return journal;
}

void reportTrouble(Journal* journal, const Bake& b) {
  if (!journal) return;
  if (const std::string trouble = journal->trouble(); !trouble.empty())
    b.run.warn({{}, nameOf(b.options), "", fmt::format("trouble with the journal: {}", trouble), "LMC_RESUME"});
}

std::string goesOnText(const Journal& journal, const BakeOptions& o, double done) {
  return line("note", nameOf(o), "",
              fmt::format("ended at {:.0f} % of the work; {} finished tiles ({:.1f} MB) are kept, and the same command goes on with them",
                          100.0 * std::min(1.0, done), journal.tilesKept(), double(journal.bytes()) / 1e6),
              "LMC_RESUME");
}

nlohmann::ordered_json resumeOf(const Journal& journal) {
  return {{"tiles_found", journal.tilesFound()},
          {"tiles_taken", journal.tilesTaken()},
          {"tiles_kept", journal.tilesKept()},
          {"journal_bytes", journal.bytes()}};
}

bool mayGoOn(const Error& e) { return e.kind == Exit::Io || e.kind == Exit::Limit; }

}  // namespace lmc
