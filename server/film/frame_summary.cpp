#include "server/film/frame_summary.h"

#include <nlohmann/json.hpp>

#include "contract/pass_schedule.h"

namespace tessera::server {

using nlohmann::json;

bool FrameSummary::fits(const contract::RenderSettings& settings) const {
  return spp == contract::rounded_spp(settings.spp) && error == settings.error;
}

std::string write_frame_note(const FrameSummary& note) {
  json document = {{"spp", note.spp},          {"samples", note.samples},
                   {"units", note.unit_count}, {"warnings", note.warnings},
                   {"reasons", note.reasons},  {"entry", json::parse(note.entry_json)}};
  if (note.error) document["error"] = *note.error;
  if (note.certainty) document["certainty"] = certainty_name(*note.certainty);
  return document.dump();
}

FrameSummary read_frame_note(const std::string& text) {
  FrameSummary note;
  const json document = json::parse(text, nullptr, false);
  if (!document.is_object()) return note;
  note.spp = document.value("spp", 0);
  note.samples = document.value("samples", std::int64_t{0});
  note.unit_count = document.value("units", std::int64_t{0});
  note.warnings = document.value("warnings", note.warnings);
  note.reasons = document.value("reasons", note.reasons);
  note.entry_json = document.value("entry", json::object()).dump();
  if (document.contains("error")) note.error = document["error"].get<double>();
  if (document.contains("certainty")) {
    note.certainty = parse_certainty(document["certainty"].get<std::string>());
  }
  return note;
}

}  // namespace tessera::server
