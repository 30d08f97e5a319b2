// A worker's timer: browsers slow down those of a page that is not seen, not those of its workers.
// A frozen tab sends nothing all the same, for the page itself sends the beats.
let timer = 0;
onmessage = ({ data: every_ms }) => {
  clearInterval(timer);
  timer = every_ms ? setInterval(() => postMessage(null), every_ms) : 0;
};
