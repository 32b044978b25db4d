#include "server/service/access/worker_admission.h"

#include <chrono>

#include "contract/digest.h"

namespace tessera::server {

void WorkerAdmission::admit(const Caller& caller, const std::string& worker_id,
                            const std::string& token,
                            const std::function<void(absl::StatusOr<std::string>)>& done) {
  if (!tokens_) return done("");
  const std::string key = coordinator_.workers().session_key(worker_id, caller.certificate());
  if (contract::equal_in_constant_time(contract::sha256(token), contract::sha256(key))) {
    return done(key);
  }
  if (token.empty()) {
    return done(absl::UnauthenticatedError(
        "join token required: pass --token FILE (create one with `tessera-server tokens create`)"));
  }
  io_.post([=, this, certificate = caller.certificate()] {
    const std::int64_t now_s = std::chrono::duration_cast<std::chrono::seconds>(
                                   std::chrono::system_clock::now().time_since_epoch())
                                   .count();
    const auto found = tokens_->find(token, now_s);
    if (!found.ok()) return done(found.status());
    coordinator_.workers().record_join({worker_id, found->id, certificate}, found->max_joins,
                                       [done, key](const absl::Status& status) {
                                         if (status.ok()) return done(key);
                                         done(status);
                                       });
  });
}

}  // namespace tessera::server
