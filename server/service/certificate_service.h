#pragma once

#include <map>
#include <string>

#include "absl/base/thread_annotations.h"
#include "server/service/access/access.h"
#include "server/sync/io_pool.h"
#include "server/sync/mutex.h"
#include "tessera/v1/certificate_service.grpc.pb.h"

namespace tessera::server {

/// gRPC front end of the farm's authority: renews certificates of callers.
class CertificateService final : public v1::CertificateService::CallbackService {
 public:
  /// `access` must outlive the server that this is registered with. `certs`: directory of the
  /// authority; empty: there are no certificates.
  CertificateService(const Access& access, std::string certs)
      : access_(access), certs_(std::move(certs)) {}

  grpc::ServerUnaryReactor* RenewCertificate(grpc::CallbackServerContext* context,
                                             const v1::RenewCertificateRequest* request,
                                             v1::RenewCertificateResponse* response) override;

 private:
  absl::Status count(const Identity& identity);

  const Access& access_;
  const std::string certs_;
  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  /// By serial number of the certificate that was presented.
  std::map<std::string, int> renewals_ ABSL_GUARDED_BY(mutex_);
  IoPool io_{1};  // reads and writes the authority's files
};

}  // namespace tessera::server
