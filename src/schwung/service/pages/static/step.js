// What a step of the wizard shows. The focus goes to the steps' bar with it, in the same moment: sent afterwards, it could
// take the focus from a field that somebody has begun to type into.
export default {
  template: `<div class="sw-column"><slot></slot></div>`,
  props: { heading: String },
  mounted() { if (this.heading) document.getElementById(this.heading)?.focus(); },
};
