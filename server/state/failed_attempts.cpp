#include "server/state/failed_attempts.h"

#include <nlohmann/json.hpp>

#include "server/telemetry/event_log.h"

namespace tessera::server {

using nlohmann::json;

std::string write_failed_attempts(const std::vector<FailedAttempt>& attempts) {
  if (attempts.empty()) return "";
  json list = json::array();
  for (const FailedAttempt& attempt : attempts) {
    const contract::Unit& unit = attempt.unit;
    list.push_back({unit.frame, unit.tile, unit.pass, attempt.worker_id,
                    cut_text(attempt.message, EventLog::kMaxTextBytes)});
  }
  return list.dump(-1, ' ', false, json::error_handler_t::replace);
}

std::vector<FailedAttempt> read_failed_attempts(const std::string& text) {
  std::vector<FailedAttempt> attempts;
  const json list = json::parse(text, nullptr, false);
  if (!list.is_array()) return attempts;
  for (const json& entry : list) {
    const bool is_known = entry.is_array() && entry.size() == 5 && entry[0].is_number_integer() &&
                          entry[1].is_number_integer() && entry[2].is_number_integer() &&
                          entry[3].is_string() && entry[4].is_string();
    if (!is_known) continue;
    attempts.push_back(
        {{entry[0].get<std::int32_t>(), entry[1].get<std::int32_t>(), entry[2].get<std::int32_t>()},
         entry[3].get<std::string>(),
         entry[4].get<std::string>()});
  }
  return attempts;
}

}  // namespace tessera::server
