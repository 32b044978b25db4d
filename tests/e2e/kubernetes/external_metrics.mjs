// An adapter of external metrics, such as prometheus-adapter is: serves tessera_units_waiting of
// deploy/kubernetes/autoscaled/adapter-rule.yaml from the metrics of one server.
//
//   node external_metrics.mjs PORT KEY CERTIFICATE METRICS_URL
import {readFileSync} from 'node:fs';
import http from 'node:http';
import https from 'node:https';

const [port, key, certificate, url] = process.argv.slice(2);
const group = 'external.metrics.k8s.io/v1beta1';
const metric = 'tessera_units_waiting';

const scrape = () => new Promise((resolve, reject) => {
  http.get(url, (answer) => {
    let text = '';
    answer.on('data', (part) => { text += part; });
    answer.on('end', () => resolve(text));
  }).on('error', reject);
});

async function waitingUnits() {
  const lines = (await scrape()).split('\n').filter((line) => line.startsWith('tessera_units{') && line.includes('state="waiting"'));
  if (lines.length === 0) throw new Error('the server has no tessera_units{state="waiting"}');
  return lines.reduce((sum, line) => sum + Number(line.split(' ').pop()), 0);
}

async function answer(path) {
  if (path === `/apis/${group}`) {
    return {kind: 'APIResourceList', apiVersion: 'v1', groupVersion: group,
            resources: [{name: metric, singularName: '', namespaced: true, kind: 'ExternalMetricValueList', verbs: ['get']}]};
  }
  if (path === `/apis/${group}/namespaces/tessera/${metric}`) {
    return {kind: 'ExternalMetricValueList', apiVersion: group, metadata: {},
            items: [{metricName: metric, metricLabels: {namespace: 'tessera'}, timestamp: new Date().toISOString(),
                     value: String(await waitingUnits())}]};
  }
  return null;
}

https.createServer({key: readFileSync(key), cert: readFileSync(certificate)}, async (request, response) => {
  response.setHeader('content-type', 'application/json');
  try {
    const document = await answer(request.url.split('?')[0]);
    if (document === null) response.statusCode = 404;
    response.end(JSON.stringify(document ?? {}));
  } catch (error) {
    response.statusCode = 503;
    response.end(JSON.stringify({message: String(error)}));
  }
}).listen(Number(port), '0.0.0.0');
