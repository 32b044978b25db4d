#include "server/schedule/plan/audit.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"

namespace tessera::server {

bool is_drawn_for_audit(std::string_view store_key, const std::string& job_id,
                        const contract::Unit& unit, double fraction) {
  const contract::Digest draw = contract::hmac_sha256(
      store_key, absl::StrCat("audit\n", job_id, "\n", unit.frame, " ", unit.tile, " ", unit.pass));
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < 8; ++i) bits = bits << 8 | draw.bytes[i];
  return static_cast<double>(bits >> 11) * 0x1p-53 < fraction;  // uniform in [0, 1)
}

bool Audit::Answers::is_consistent() const {
  return std::all_of(digests.begin(), digests.end(),
                     [this](const contract::Digest& digest) { return digest == digests.front(); });
}

Audit::Audit(std::string committer, const contract::Digest& committed, std::string witness)
    : answers_{{std::move(committer), std::move(witness), {committed}}} {
  if (answers_.front().witness.empty()) answers_.front().witness = answers_.front().worker_id;
}

std::set<std::string> Audit::witnesses() const {
  std::set<std::string> names;
  for (const Answers& answers : answers_) names.insert(answers.witness);
  return names;
}

bool Audit::has_answered(const std::string& witness) const {
  return std::any_of(answers_.begin(), answers_.end(),
                     [&](const Answers& answers) { return answers.witness == witness; });
}

bool Audit::may_ask(const std::string& witness, bool others) const {
  for (const Answers& answers : answers_) {
    if (answers.witness != witness) continue;
    return !others && is_disputed() && answers.digests.size() == 1;
  }
  return true;
}

void Audit::answer(const std::string& worker_id, const contract::Digest& digest,
                   const std::string& witness) {
  const std::string& name = witness.empty() ? worker_id : witness;
  for (Answers& answers : answers_) {
    if (answers.witness == name) return answers.digests.push_back(digest);
  }
  answers_.push_back({worker_id, name, {digest}});
}

void Audit::disregard(const std::string& witness) {
  if (witness == answers_.front().witness) return;
  std::erase_if(answers_, [&](const Answers& answers) { return answers.witness == witness; });
}

void Audit::restart() {
  answers_.resize(1, answers_.front());
  answers_.front().digests.resize(1);
}

bool Audit::is_disputed() const {
  const contract::Digest& first = answers_.front().digests.front();
  return std::any_of(answers_.begin(), answers_.end(), [&](const Answers& answers) {
    return !answers.is_consistent() || answers.digests.front() != first;
  });
}

int Audit::consistent_count() const {
  return static_cast<int>(
      std::count_if(answers_.begin(), answers_.end(),
                    [](const Answers& answers) { return answers.is_consistent(); }));
}

std::optional<contract::Digest> Audit::agreed() const {
  for (const Answers& one : answers_) {
    for (const Answers& other : answers_) {
      if (&one == &other || !one.is_consistent() || !other.is_consistent()) continue;
      if (one.digests.front() == other.digests.front()) return one.digests.front();
    }
  }
  return std::nullopt;
}

bool Audit::is_settled() const {
  if (agreed()) return true;
  return answers_.size() > 1 && consistent_count() <= 1;
}

std::vector<std::string> Audit::faulty_workers() const {
  const auto truth = agreed();
  std::vector<std::string> faulty_workers;
  for (const Answers& answers : answers_) {
    const bool differs = truth && answers.digests.front() != *truth;
    if (!answers.is_consistent() || differs) faulty_workers.push_back(answers.worker_id);
  }
  return faulty_workers;
}

}  // namespace tessera::server
