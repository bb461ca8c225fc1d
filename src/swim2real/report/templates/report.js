(() => {
  "use strict";
  // on paper everything is open
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printing");
    document.querySelectorAll("details").forEach((one) => (one.open = true));
  });
  addEventListener("afterprint", () => document.documentElement.classList.remove("printing"));
})();
